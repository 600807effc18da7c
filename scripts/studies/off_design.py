"""Every tuner off its design point: the same episodes for all, evaluated on the true vehicle.

Gains and trust are those of `Tuner.assess`, with offsets and starts taken out; learners come
alone (`studies.players`), and the ladder is a tuner of its own.  Where a tuner refuses a recording,
its cell has the message.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from studies.bounds import bound_on
from studies.conditions import SWEEPS, Level, Sweep
from studies.draws import draw, recorded
from studies.metrics import bootstrap_interval, rms
from studies.trusting import MISS
from tuners import Tuner
from tuners.tuner.recording import Recording
from yawrate_env import validation
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

_CHUNK = 100


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Root mean square distance from the target over the stable loops.

    Attributes
    ----------
    rms : float or None
        None where no loop is stable.
    interval : tuple of float or None
        95 % bootstrap interval over episodes.
    bound : float or None
        Root mean square of the Cramer-Rao bound over the same episodes, where it applies.
    ratio : float or None
        Of the two.
    """

    rms: float | None
    interval: tuple[float, float] | None
    bound: float | None
    ratio: float | None

    @classmethod
    def of(cls, errors: Array, bound: float | None = None) -> "Accuracy":
        """Sum up errors (B,), those that are finite."""
        found = errors[np.isfinite(errors)]
        if not len(found):
            return cls(None, None, bound, None)
        value = float(rms(found))
        ratio = value / bound if bound else None
        return cls(value, bootstrap_interval(found, rms), bound, ratio)


@dataclass(frozen=True, slots=True)
class Cell:
    """One tuner at one level of one condition.

    Attributes
    ----------
    condition, level, tuner
        Which.
    episodes : int
        How many it was given.
    phase_margin, crossover : Accuracy
        [deg] and [Hz], on the true vehicle.
    unstable, misses : int
        Unstable loops; these and those farther from the target than `MISS`.
    trusted, trusted_misses : int
        Episodes whose gains were trusted; those that should not have been.
    refused : str
        Why the tuner could not be used at all.
    """

    condition: str
    level: Level
    tuner: str
    episodes: int
    phase_margin: Accuracy
    crossover: Accuracy
    unstable: int
    misses: int
    trusted: int
    trusted_misses: int
    refused: str = ""


def study(
    tuners: Mapping[str, Tuner],
    task: Task,
    *,
    episodes: int,
    seed: int = 0,
    sweeps: Sequence[Sweep] = SWEEPS,
    progress: Progress | None = None,
) -> list[Cell]:
    """Measure all tuners at all levels; the design point, which all sweeps share, once.

    Parameters
    ----------
    tuners : mapping
        By name.
    task : Task
        Design point that the conditions depart from.
    episodes, seed : int
        Of the ``test`` set.
    progress : callable, optional
        Called with the condition, how many of its levels are done, and of how many.
    """
    validation.count("episodes", episodes)
    validation.count("seed", seed, at_least=0)
    cells: list[Cell] = []
    at_design: list[Cell] = []
    for sweep in sweeps:
        for i, level in enumerate(sweep.levels):
            if level == sweep.design and at_design:
                found = [replace(c, condition=sweep.name, level=level) for c in at_design]
            else:
                found = measure(tuners, task, sweep, level, episodes, seed)
            cells += found
            at_design = found if level == sweep.design else at_design
            if progress is not None:
                progress(sweep.name, i + 1, len(sweep.levels))
    return cells


def measure(
    tuners: Mapping[str, Tuner],
    task: Task,
    sweep: Sweep,
    level: Level,
    episodes: int,
    seed: int,
) -> list[Cell]:
    """Give every tuner the same episodes at one level of one condition."""
    true_task, transformed = sweep.make(task, level)
    truth = yaw_rate(true_task)
    parts: dict[str, list[Array]] = {name: [] for name in tuners}
    refused: dict[str, str] = {}
    for first in range(0, episodes, _CHUNK):
        drawn = draw(truth, "test", seed, first, min(_CHUNK, episodes - first))
        recording = transformed(recorded(truth, drawn), drawn)
        for name in tuners.keys() - refused.keys():
            try:
                parts[name].append(answered(tuners[name], recording, truth, drawn.theta))
            except ValueError as error:
                refused[name] = str(error)
    bound = None
    if sweep.bounded or level == sweep.design:
        bound = rms(bound_on(truth, "test", seed, episodes))
    nothing = np.empty((0, 4))
    return [
        cell(
            (sweep.name, level, name, episodes),
            nothing if name in refused else np.concatenate(parts[name]),
            truth.target or (),
            bound,
            refused.get(name, ""),
        )
        for name in tuners
    ]


def answered(tuner: Tuner, recording: Recording, truth: Plant, theta: Array) -> Array:
    """(B, 4) of phase_margin [deg], crossover [Hz], and stable and trusted as 0 or 1.

    Margins are those with the true plants `theta` (B, p); ``nan`` where the loop is unstable.
    """
    gains, found = tuner.assess(recording)
    values, stable = truth.evaluation(theta, gains.values)
    margins = np.where(stable[:, None], values[:, :2], np.nan)
    return np.column_stack([margins, stable, found.trusted])


def cell(
    which: tuple[str, Level, str, int],
    answers: Array,
    target: Sequence[float],
    bound: Array | None,
    refused: str = "",
) -> Cell:
    """Sum up what `answered` gave; `which` is condition, level, tuner and episodes."""
    errors = answers[:, :2] - target
    stable, trusted = answers[:, 2:].T == 1
    missed = ~(np.abs(errors) <= MISS).all(axis=1)  # not-a-number is a miss
    pm, fc = (Accuracy.of(errors[:, i], None if bound is None else float(bound[i])) for i in (0, 1))
    return Cell(
        *which, pm, fc,
        unstable=int((~stable).sum()),
        misses=int(missed.sum()),
        trusted=int(trusted.sum()),
        trusted_misses=int((missed & trusted).sum()),
        refused=refused,
    )  # fmt: skip
