"""Suggestions where no plant reproduces a recording: another sign, or another time."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.logs import Log
from tuners.tuner.reasons import looped
from tuners.tuner.result import Result

Array = NDArray[np.float64]
Tune = Callable[[Array, Array, dict[str, Array]], Result]

STEP, LATEST = 0.001, 0.03
"""Shifts of the output that are tried, in lengths of the plant's experiment."""


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """Tune an altered recording."""

    tune: Tune
    log: Log

    def __call__(self, *, sign: int = 1, late: int = 0) -> Result:
        """With the input times `sign`, and the output `late` samples earlier."""
        log = self.log
        u, y = sign * log.u[..., : log.u.shape[-1] - late], log.y[..., late:]
        return self.tune(u, y, {name: values[late:] for name, values in log.measured.items()})


def hints(tune: Tune, log: Log, result: Result, input_scale: float) -> tuple[str, ...]:
    """What makes a plant reproduce the recording, if none does and something is found.

    Parameters
    ----------
    tune : callable
        ``tune(u, y, measured)`` for a recording at the log's sampling time.
    result : Result
        For the recording as it is.
    input_scale : float
        Scale of the input as the user gave it.
    """
    if fits(result) or looped(result.checks):
        return ()
    trial = Trial(tune, log)
    length = result.plant.samples * result.plant.Ts
    step, latest = round(STEP * length / log.Ts), int(LATEST * length / log.Ts + 1e-9)
    try:
        if fits(trial(sign=-1)):
            return (f"With the input's sign reversed the recording fits: {_flip(input_scale)}.",)
        late = lateness(trial, misfit(result), max(step, 1), latest)
    except ValueError:  # a plant's own code may refuse an altered recording
        return ()
    if late is None:
        return ()
    ms = 1e3 * late * log.Ts
    return (f"The output seems to be logged {ms:.4g} ms late: shifted by that, it fits.",)


def lateness(trial: Trial, least: float, step: int, latest: int) -> int | None:
    """By how many samples earlier the output fits; the search ends where the misfit grows."""
    for late in range(step, latest + 1, step):
        found = trial(late=late)
        if fits(found):
            return late
        if not misfit(found) < least:
            return None
        least = misfit(found)
    return None


def fits(result: Result) -> bool:
    """Whether a plant of the simulator reproduces the recording."""
    return all(check.passed for check in result.checks if check.name == "misfit")


def misfit(result: Result) -> float:
    """Share of the output that it does not reproduce."""
    return next(check.value for check in result.checks if check.name == "misfit")


def _flip(input_scale: float) -> str:
    if input_scale > 0:
        return "try --flip-input"
    return "leave out --flip-input, or reverse the sign of --input-scale"
