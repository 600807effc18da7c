"""What would make a vehicle fit a recording that none does: another sign, or another time."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tuners.logs import Log
from tuners.result import TuningResult

if TYPE_CHECKING:
    from tuners import Tuner

STEP, LATEST = 0.01, 0.3  # [s]


@dataclass(frozen=True, slots=True)
class Trial:
    """The tuner's answer to a recording that was altered."""

    tuner: "Tuner"
    log: Log
    start: str

    def __call__(self, *, sign: int = 1, late: int = 0) -> TuningResult:
        """With the steering times `sign`, and the yaw rate `late` samples earlier."""
        log, last = self.log, len(self.log.steer) - late
        steer, yaw_rate, speed = sign * log.steer[:last], log.yaw_rate[late:], log.speed[late:]
        return self.tuner.tune(steer, yaw_rate, log.Ts, speed, self.start)


def hints(
    tuner: "Tuner", log: Log, result: TuningResult, start: str, flipped: bool
) -> tuple[str, ...]:
    """In words, what makes a vehicle fit, if none does and something is found.

    Parameters
    ----------
    start : {"auto", "rest", "unknown"}
        As the tuner was told.
    flipped : bool
        Whether the steering's sign was reversed already.
    """
    if fits(result):
        return ()
    trial = Trial(tuner, log, start)
    if fits(trial(sign=-1)):
        remedy = "leave out" if flipped else "try"
        return (f"With the steering's sign reversed a vehicle fits: {remedy} --flip-steer.",)
    late = lateness(trial, misfit(result))
    if late is None:
        return ()
    return (f"The yaw rate seems to be logged {1e3 * late:.0f} ms late: earlier, a vehicle fits.",)


def lateness(trial: Trial, least: float) -> float | None:
    """By how much earlier a vehicle fits the yaw rate [s], walking on while the misfit falls."""
    Ts = trial.log.Ts
    samples = max(1, round(STEP / Ts))
    for late in range(samples, int(LATEST / Ts + 1e-9) + 1, samples):
        found = trial(late=late)
        if fits(found):
            return late * Ts
        if not misfit(found) < least:
            return None
        least = misfit(found)
    return None


def fits(result: TuningResult) -> bool:
    """Whether some vehicle answers the command as the recording does."""
    return all(check.passed for check in result.checks if check.name == "misfit")


def misfit(result: TuningResult) -> float:
    """How much of the yaw rate none explains."""
    return next(check.value for check in result.checks if check.name == "misfit")
