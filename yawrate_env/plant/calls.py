"""Calls of functions that a plant's author wrote; errors name the function."""

from collections.abc import Callable, Iterable, Sequence
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
    name: str,
    function: Callable[..., Any],
    shape: tuple[int, ...],
    batched: bool,
    *arrays: Array,
    names: Sequence[str] = (),
) -> tuple[Array, Flags | None]:
    """Call for the batch, or for each plant, and check that the answer is (B, *shape).

    A function may answer with a pair; the second part, (B,) bool, is then returned too.  Where it
    raises, the message says for which plant, with the `names` of its parameters.
    """
    count, answer = len(arrays[0]), f"{name}'s answer"
    if batched:
        values, found = _batch(name, function, names, *arrays)
    else:
        given = zip(*arrays, strict=True)
        values, found = _one_by_one(name, function, names, shape, given)
    values = validation.float_array(answer, values)
    if values.shape != (count, *shape):
        raise ValueError(f"{answer} has shape {values.shape}, not {(count, *shape)}.")
    if found is None:
        return values, None
    flags = np.asarray(found)
    if flags.shape != (count,) or flags.dtype != np.bool_:
        raise ValueError(
            f"{name}'s second answer has shape {flags.shape} and type {flags.dtype}, not "
            f"{(count,)} and bool."
        )
    return values, flags


def _batch(
    name: str, function: Callable[..., Any], names: Sequence[str], *arrays: Array
) -> tuple[Any, Any]:
    """A batch's values and flags; where it raises, the first plant that does so alone is named."""
    try:  # functions may write into what they are given
        values = call(name, function, *(array.copy() for array in arrays))
    except ValueError:
        for i in range(len(arrays[0])):
            alone = [array[i : i + 1].copy() for array in arrays]
            call(f"{name}{_at(names, arrays[0][i])}", function, *alone)
        raise
    return values if _is_pair(values) else (values, None)


def _one_by_one(
    name: str,
    function: Callable[..., Any],
    names: Sequence[str],
    shape: tuple[int, ...],
    given: Iterable[tuple[Array, ...]],
) -> tuple[Any, Any]:
    """Values and flags of a function that takes one plant."""
    values, found = [], []
    for row in given:
        at = _at(names, row[0])
        one = call(f"{name}{at}", function, *(array.copy() for array in row))
        if _is_pair(one):
            one, flag = one
            found.append(flag)
        one = validation.float_array(f"{name}'s answer", one)
        if one.shape != shape:
            raise ValueError(f"{name}'s answer{at} has shape {one.shape}, not {shape}.")
        values.append(one)
    return np.reshape(values, (len(values), *shape)), found or None


def _at(names: Sequence[str], theta: Array) -> str:
    """Which plant a message is about."""
    pairs = zip(names, theta, strict=False)
    listed = ", ".join(f"{name} = {value:.4g}" for name, value in pairs)
    return f" for {listed}" if listed else ""


def _is_pair(answer: Any) -> bool:
    """Whether it is values and flags; two gains of one plant may be a tuple, too."""
    return isinstance(answer, tuple) and len(answer) == 2 and np.asarray(answer[1]).dtype == bool
