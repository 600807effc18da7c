"""Calls of functions that a plant's author wrote; errors name the function."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def call(name: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """Call the function; ``ValueError`` with its name if it raises, the cause attached."""
    try:
        return function(*arguments)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # such as an exit
        raise ValueError(f"{name} failed: {one_line(error)}") from error


def one_line(error: BaseException) -> str:
    """An error's type and text in one line."""
    try:
        text = f"{type(error).__name__}: {error}"
    except Exception:  # an author's error may fail to describe itself
        text = type(error).__name__
    return " ".join(text.split()).removesuffix(":")


def rows(
    name: str, function: Callable[..., Any], width: int, batched: bool, *arrays: Array
) -> tuple[Array, Flags | None]:
    """Call for the batch, or for each plant, and check that the answer is (B, width).

    A function may answer with a pair; the second part, (B,) bool, is then returned too.
    """
    arrays = tuple(array.copy() for array in arrays)  # functions may write into them
    count, answer, found = len(arrays[0]), f"{name}'s answer", None
    if batched:
        values = call(name, function, *arrays)
        if _is_pair(values):
            values, found = values
    else:
        values = [call(name, function, *row) for row in zip(*arrays, strict=True)]
        if values and _is_pair(values[0]):
            values, found = zip(*values, strict=True)
        values = [validation.float_array(answer, row) for row in values]
    values = validation.float_array(answer, values)
    if values.shape != (count, width):
        raise ValueError(f"{answer} has shape {values.shape}, not {(count, width)}.")
    if found is None:
        return values, None
    flags = np.asarray(found)
    if flags.shape != (count,) or flags.dtype != np.bool_:
        raise ValueError(
            f"{name}'s second answer has shape {flags.shape} and type {flags.dtype}, not "
            f"{(count,)} and bool."
        )
    return values, flags


def _is_pair(answer: Any) -> bool:
    """Whether it is values and flags; two gains of one plant may be a tuple, too."""
    return isinstance(answer, tuple) and len(answer) == 2 and np.asarray(answer[1]).dtype == bool
