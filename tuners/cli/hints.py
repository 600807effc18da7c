"""What would make a simulator fit a recording that it does not: another sign, or another time."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tuners.tuner.result import Check

Array = NDArray[np.float64]


class Answer(Protocol):
    """A vehicle's or a plant's result."""

    @property
    def checks(self) -> tuple[Check, ...]:
        """What was looked at."""


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """A tuner's answer to a recording that was altered.

    Attributes
    ----------
    tune : callable
        ``tune(u, y)`` for input and output (M,), of a recording (N,) the last of both.
    u, y : NDArray
        (N,) the recording.
    """

    tune: Callable[[Array, Array], Answer]
    u: Array
    y: Array

    def __call__(self, *, sign: int = 1, late: int = 0) -> Answer:
        """With the input times `sign`, and the output `late` samples earlier."""
        return self.tune(sign * self.u[: len(self.u) - late], self.y[late:])


def hints(
    trial: Trial, found: Answer, step: int, latest: int, sign: str, late: Callable[[int], str]
) -> tuple[str, ...]:
    """In words, what makes the simulator fit, if it does not and something is found.

    Parameters
    ----------
    found : TuningResult or PlantResult
        For the recording as it is.
    step, latest : int
        By how much earlier outputs are tried, in samples.
    sign : str
        What to say where it fits with the input's sign reversed.
    late : callable
        What to say where it fits so many samples earlier.
    """
    if fits(found):
        return ()
    try:
        if fits(trial(sign=-1)):
            return (sign,)
        samples = lateness(trial, misfit(found), max(step, 1), latest)
    except ValueError:  # an altered recording may be none that a plant's own code takes
        return ()
    return () if samples is None else (late(samples),)


def lateness(trial: Trial, least: float, step: int, latest: int) -> int | None:
    """By how many samples earlier the output fits, walking on while the misfit falls."""
    for late in range(step, latest + 1, step):
        found = trial(late=late)
        if fits(found):
            return late
        if not misfit(found) < least:
            return None
        least = misfit(found)
    return None


def fits(found: Answer) -> bool:
    """Whether the simulator answers the input as the recording does."""
    return all(check.passed for check in found.checks if check.name == "misfit")


def misfit(found: Answer) -> float:
    """How much of the output it does not explain."""
    return next(check.value for check in found.checks if check.name == "misfit")
