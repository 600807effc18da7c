"""Checks at the public edges: every refusal names the value, the bound and the remedy."""

import math
from numbers import Real
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

T = TypeVar("T")


def number(
    name: str,
    value: Any,
    *,
    above: float = -math.inf,
    at_least: float = -math.inf,
    below: float = math.inf,
    at_most: float = math.inf,
    remedy: str = "",
) -> float:
    """Return `value` as a finite float within its bounds, or raise ``ValueError``.

    Parameters
    ----------
    name : str
        Name of the argument.
    value : float
        The value to check.
    above, below : float
        Exclusive bounds.
    at_least, at_most : float
        Inclusive bounds.
    remedy : str
        A sentence with the correction.
    """
    if isinstance(value, bool) or not isinstance(value, Real):
        raise ValueError(f"{name} = {value!r} is not a number. {remedy}".strip())
    try:
        result = float(value)
    except OverflowError:
        result = math.inf
    within = above < result < below and at_least <= result <= at_most
    if not (math.isfinite(result) and within):
        bound = _bound(above, at_least, below, at_most)
        raise ValueError(f"{name} = {result:g} must be {bound}. {remedy}".strip())
    return result


def count(
    name: str, value: Any, *, at_least: int = 1, at_most: float = math.inf, remedy: str = ""
) -> int:
    """Return `value` as an int within its bounds, or raise ``ValueError``."""
    result = number(name, value, at_least=at_least, at_most=at_most, remedy=remedy)
    if not result.is_integer():
        raise ValueError(f"{name} = {result:g} must be a whole number. {remedy}".strip())
    return int(result)


def like(
    name: str, value: Any, usual: Any, *, zero: bool = False, at_most: float = math.inf
) -> float:
    """Return `value` if it is within a factor of 1000 of the `usual` one, or raise ``ValueError``.

    Numerics are safe there, and values beyond are mistakes of units.  With `zero`, smaller
    values are accepted too.
    """
    return number(
        name,
        value,
        at_least=0.0 if zero else 1e-3 * usual,
        at_most=min(1e3 * usual, at_most),
        remedy="Use SI units.",
    )


def interval(name: str, value: Any) -> tuple[float, float]:
    """Return ``(low, high)`` from a number (a point) or a pair, or raise ``ValueError``."""
    if isinstance(value, Real):
        point = number(name, value)
        return point, point
    pair = isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim == 1)
    if not pair or len(value) != 2:
        raise ValueError(f"{name} = {value!r} must be a number or a pair [low, high].")
    low, high = (number(f"{name}[{i}]", v) for i, v in enumerate(value))
    if low > high:
        raise ValueError(f"{name} = [{low:g}, {high:g}] has low above high. Swap the two.")
    return low, high


def one_of(name: str, value: Any, choices: tuple[str, ...]) -> str:
    """Return `value` if it is one of `choices`, or raise ``ValueError``."""
    if value not in choices:
        raise ValueError(f"{name} = {value!r} is unknown. Choose one of {', '.join(choices)}.")
    return str(value)


def text(name: str, value: Any, *, remedy: str = "") -> str:
    """Return `value` if it is text that is not blank, or raise ``ValueError``."""
    if not isinstance(value, str) or not value.strip():
        raise ValueError(f"{name} = {value!r} must be text that is not empty. {remedy}".strip())
    return value


def flag(name: str, value: Any) -> bool:
    """Return `value` if it is True or False, or raise ``ValueError``."""
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{name} = {value!r} must be True or False.")
    return bool(value)


def instance(name: str, value: Any, kind: type[T], *, remedy: str) -> T:
    """Return `value` if it is of that type, or raise ``ValueError``."""
    if not isinstance(value, kind):
        raise ValueError(f"{name} = {value!r} is not of type {kind.__name__}. {remedy}")
    return value


def function(name: str, value: Any, *, optional: bool = False) -> Any:
    """Return `value` if it can be called, or is None and optional; or raise ``ValueError``."""
    if not (callable(value) or (optional and value is None)):
        raise ValueError(
            f"{name} = {value!r} cannot be called. Give a function{', or None' * optional}."
        )
    return value


def real_array(name: str, value: ArrayLike) -> NDArray[Any]:
    """Return `value` as an array of real numbers, or raise ``ValueError``.

    NumPy would drop a mask and an imaginary part, and read text and bool as numbers.
    """
    if np.ma.is_masked(value):
        masked = int(np.ma.getmaskarray(np.ma.asarray(value)).sum())
        raise ValueError(f"{name} has {masked} masked samples. Fill or cut them first.")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name} is not an array of numbers.") from None
    kind, odd = array.dtype.kind, str | bytes | bool
    if kind not in "iufO" or (kind == "O" and any(isinstance(x, odd) for x in array.flat)):
        raise ValueError(
            f"{name} is not an array of numbers but of {array.dtype}. Give real numbers."
        )
    return array


def float_array(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Return `value` as float64, or raise ``ValueError`` where it is not real numbers."""
    real = real_array(name, value)
    try:
        return np.asarray(real, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} is not an array of numbers.") from None


def finite_array(
    name: str, value: ArrayLike, *, shape: tuple[int | None, ...]
) -> NDArray[np.float64]:
    """Return `value` as a finite float64 array of `shape` (``None``: any), or raise."""
    array = float_array(name, value)
    fits = array.ndim == len(shape) and all(
        want is None or want == have for want, have in zip(shape, array.shape, strict=True)
    )
    if not fits:
        expected = "(" + ", ".join("any" if s is None else str(s) for s in shape) + ")"
        raise ValueError(f"{name} has shape {array.shape}, not {expected}. Reshape it.")
    if not np.isfinite(array).all():
        first = int(np.flatnonzero(~np.isfinite(array.ravel()))[0])
        raise ValueError(
            f"{name} has {array.ravel()[first]} at flat index {first}; every value must be finite. "
            "Remove or repair such samples first."
        )
    return array


def _bound(above: float, at_least: float, below: float, at_most: float) -> str:
    parts = ["finite"]
    if above > -math.inf:
        parts.append(f"above {above:g}")
    if at_least > -math.inf:
        parts.append(f"at least {at_least:g}")
    if below < math.inf:
        parts.append(f"below {below:g}")
    if at_most < math.inf:
        parts.append(f"at most {at_most:g}")
    return ", ".join(parts)
