"""How wrong the vehicle's data may be: accuracy, intervals and verdicts over the degree.

All parameters are wrong, each by up to the degree.  Intervals of learner and fitted plant are
those that take the data for exact; those of black box and ladder are the recording's own.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from studies.drives import Fault, record
from studies.faulty import Array
from studies.metrics import bootstrap_interval, rms
from studies.players import alone
from studies.robustness import PLAYERS, Condition
from studies.trusting import MISS
from studies.vehicle_steps import NAMES, wrong
from tuners import Tuner, load
from tuners.trust.verdict import Verdict
from yawrate_env import validation
from yawrate_env.vehicle.task import Task

Progress = Callable[[str, int, int], None]

DEGREES = (0.0, 2.0, 5.0, 10.0, 20.0, 30.0)
"""By up to which all of the vehicle's data are wrong [%]."""

CONDITION = Condition(30.0, 10.0)

_CHUNK = 100
_SIMULATED = PLAYERS[:2]  # whose intervals take the vehicle's data for exact


@dataclass(frozen=True, slots=True)
class Level:
    """One player at one degree.

    Attributes
    ----------
    degree : float
        By up to which the vehicle's data are wrong [%].
    player : str
        Whose gains.
    recordings, misses : int
        All, and those that miss.
    rms, interval : float or None, tuple of float or None
        Root mean square distance of the phase margin from what is reachable, over the stable
        loops, and its 95 % bootstrap interval [deg].
    covered : float
        Share of 90 % intervals of the phase margin that contain the true one.
    usable, careful : float
        Share of verdicts "usable", and "usable with care".
    """

    degree: float
    player: str
    recordings: int
    misses: int
    rms: float | None
    interval: tuple[float, float] | None
    covered: float
    usable: float
    careful: float


def players(tuner: Tuner) -> dict[str, Tuner]:
    """The tuner's rungs one by one, and the tuner."""
    others = (load(name, tuner.plant) for name in ("gb", "bb"))
    return dict(zip(PLAYERS, (alone(tuner), *others, tuner), strict=True))


def sweep(
    tuner: Tuner,
    task: Task,
    *,
    count: int,
    seed: int = 0,
    degrees: Sequence[float] = DEGREES,
    progress: Progress | None = None,
) -> list[Level]:
    """Give all players the same `count` recordings at every degree."""
    validation.count("recordings", count)
    everyone, levels = players(tuner), []
    for done, degree in enumerate(degrees, start=1):
        levels += at(everyone, CONDITION.of(task), degree, count, seed)
        if progress is not None:
            progress("degree of wrongness", done, len(degrees))
    return levels


def at(
    everyone: Mapping[str, Tuner], task: Task, degree: float, count: int, seed: int
) -> list[Level]:
    """All players at one degree [%]; vehicles, noise and signs of errors are those of any other."""
    fault = Fault(vehicle=(wrong(*NAMES, by=degree / 100),))
    parts: dict[str, list[Array]] = {name: [] for name in everyone}
    for first in range(0, count, _CHUNK):
        rng = np.random.default_rng((seed, first))
        made = record(fault, task, rng, min(_CHUNK, count - first))
        goal, reachable = made.reachable(task)
        goal[reachable] = task.target.phase_margin, task.target.crossover
        for name, player in everyone.items():
            gains, found = player.assess(made.recording)
            reached, stable = made.reached(task, gains.values)
            exact = name in _SIMULATED
            middle = found.exact_metrics if exact else found.metrics
            spread = found.exact_spread if exact else found.spread
            inside = np.abs(reached - middle) <= np.array(player.calibration) * spread
            errors = np.where(stable[:, None], reached - goal, np.nan)
            parts[name].append(np.column_stack([errors, inside[:, 0], found.verdicts]))
    return [_level(degree, name, np.concatenate(part)) for name, part in parts.items()]


def _level(degree: float, player: str, answers: Array) -> Level:
    """Sum up errors [deg], [Hz], whether an interval held, and verdicts, (B, 4)."""
    errors, held, verdicts = answers[:, :2], answers[:, 2], answers[:, 3]
    stable: NDArray[np.float64] = errors[np.isfinite(errors[:, 0]), 0]
    usable, careful = (
        float((verdicts == list(Verdict).index(v)).mean())
        for v in (Verdict.USABLE, Verdict.USABLE_WITH_CARE)
    )
    return Level(
        degree, player, len(answers),
        int((~(np.abs(errors) <= MISS).all(axis=1)).sum()),
        float(rms(stable)) if len(stable) else None,
        bootstrap_interval(stable, rms) if len(stable) else None,
        float(held.mean()), usable, careful,
    )  # fmt: skip
