"""Units, limits and checks that every digital controller shares."""

from typing import Protocol

import numpy as np

from yawrate_env import validation
from yawrate_env.plant.names import split

SLOWEST = 1e3  # [s]
SATURATED = 1e3  # the largest error's part in the output, in distances of the limits
LARGEST = float(np.finfo(np.float32).max)
"""Of single precision."""

_LEAST = float(np.finfo(np.float32).tiny)


class Limited(Protocol):
    """A controller whose command has limits."""

    @property
    def low(self) -> float:
        """Least command, in its own unit."""

    @property
    def high(self) -> float:
        """Largest command."""


def units(signals: tuple[str, str]) -> tuple[str, str]:
    """Units of command and output; where a name has none, ``unit of u``."""
    command, output = map(unit, signals)
    return command, output


def unit(signal: str) -> str:
    """A signal's unit, the part of its name in brackets."""
    name, bracket = split(signal.strip())
    return bracket or f"unit of {name}"


def check_limits(low: float, high: float, unit: str) -> None:
    """``ValueError`` unless limits of a command are finite and in order."""
    for name, value in (("low", low), ("high", high)):
        validation.number(name, value, remedy=f"Give a finite limit in {unit}.")
    if not low < high:
        raise ValueError(
            f"limits = [{low:g}, {high:g}] must have low below high. "
            f"Give the least and the largest command in {unit}."
        )


def check_single(of: Limited, positive: tuple[str, ...], signed: tuple[str, ...] = ()) -> None:
    """``ValueError`` unless single precision holds the numbers of a controller.

    Parameters
    ----------
    of : Limited
        The controller; its limits are checked, too.
    positive : tuple of str
        Names of numbers that are not 0.
    signed : tuple of str
        Names of numbers that may be 0.
    """
    for name in (*positive, *signed, "low", "high"):
        size = abs(getattr(of, name))
        least = _LEAST if size or name in positive else 0.0
        validation.number(
            f"abs({name})", size, at_least=least, at_most=LARGEST,
            remedy="Single precision must hold it: export gains, Ts and limits of ordinary size.",
        )  # fmt: skip
