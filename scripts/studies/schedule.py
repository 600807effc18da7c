"""Speed that is known but varies: the gain schedule, accuracy against speed, a wrong speed.

The schedule kp(v_x), Ti(v_x) is what one tuner for all speeds answers to one recording at
each speed, beside what the design rule gives that knows the vehicle.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from studies.conditions import SPEED, recorded
from studies.off_design import Accuracy, Cell, answered, measure, rms_of
from tuners.trust.vehicle_bound import cramer_rao
from tuners.tuner.tuner import Tuner, nominal_context
from yawrate_env import validation
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Prior, Task

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

_CHUNK = 100


@dataclass(frozen=True, slots=True)
class Schedule:
    """One vehicle's gains over speed, lists of S values.

    Attributes
    ----------
    mu_s, M_delta : float
        The vehicle.
    v_x : list of float
        Speeds [m/s].
    kp, Ti : list of float
        The tuner's, from one recording at each speed.
    oracle_kp, oracle_Ti : list of float
        The design rule's; ``nan`` where it finds none.
    phase_margin, crossover : list of float
        What the tuner's gains give [deg], [Hz].
    """

    mu_s: float
    M_delta: float
    v_x: list[float]
    kp: list[float]
    Ti: list[float]
    oracle_kp: list[float]
    oracle_Ti: list[float]
    phase_margin: list[float]
    crossover: list[float]


@dataclass(frozen=True, slots=True)
class Bin:
    """Accuracy between two speeds.

    Attributes
    ----------
    low, high : float
        [m/s]
    episodes, unstable, trusted : int
        In all, with an unstable loop, and trusted.
    phase_margin, crossover : Accuracy
        [deg], [Hz]
    """

    low: float
    high: float
    episodes: int
    unstable: int
    trusted: int
    phase_margin: Accuracy
    crossover: Accuracy


@dataclass(frozen=True, slots=True)
class Price:
    """What a wrong speed costs one tuner, at the levels of `SPEED`.

    Attributes
    ----------
    tuner : str
        Its name.
    v_x : float
        Claimed speed [m/s].
    cells : list of Cell
        One a level.
    """

    tuner: str
    v_x: float
    cells: list[Cell]

    @property
    def degrees(self) -> float:
        """Rms error of the phase_margin [deg] for 1 m/s, the mean of both directions."""
        ones = [c.phase_margin.rms for c in self.cells if c.level in (-1.0, 1.0)]
        return float(np.mean([np.nan if rms is None else rms for rms in ones]))


def vehicles(prior: Prior) -> list[tuple[float, float]]:
    """(mu_s, M_delta) in the middle of the prior and at its four corners."""
    middle = nominal_context(prior)
    corners = [(mu_s, M_delta) for mu_s in prior.mu_s for M_delta in prior.M_delta]
    return [(float(middle.mu_s[0]), float(middle.M_delta[0])), *corners]


def schedule(
    tuner: Tuner, mu_s: float, M_delta: float, speeds: Sequence[float], seed: int = 0
) -> Schedule:
    """Tune one vehicle from one recording at each speed [m/s]."""
    task = tuner.task
    draw = CONTEXT_SETS["test"].draw(task.prior, seed, 0, len(speeds))
    draw = replace(draw, context=Context.of(mu_s, M_delta, speeds))
    judge = loops(task, draw.context)
    design, _ = tuner.assess(recorded(task, draw))
    margins, oracle = judge.evaluate(design.kp, design.Ti).margins, judge.design()
    columns = (design.kp, design.Ti, oracle.kp, oracle.Ti, margins.phase_margin, margins.crossover)
    return Schedule(mu_s, M_delta, list(speeds), *(column.tolist() for column in columns))


def accuracy(
    tuner: Tuner,
    edges: Sequence[float],
    *,
    episodes: int,
    seed: int = 0,
    progress: Progress | None = None,
) -> list[Bin]:
    """Errors and bound between each two `edges` [m/s], over the tuner's own prior."""
    validation.count("episodes", episodes)
    task, parts = tuner.task, []
    for first in range(0, episodes, _CHUNK):
        draw = CONTEXT_SETS["test"].draw(task.prior, seed, first, min(_CHUNK, episodes - first))
        answers = answered(tuner, recorded(task, draw), loops(task, draw.context))
        parts.append(np.column_stack([draw.context.v_x, answers, cramer_rao(task, draw)]))
        if progress is not None:
            progress("accuracy against speed", first + len(draw), episodes)
    rows = np.concatenate(parts)
    index = np.digitize(rows[:, 0], edges[1:-1])
    return [
        _bin(task, low, high, rows[index == i])
        for i, (low, high) in enumerate(zip(edges[:-1], edges[1:], strict=True))
    ]


def _bin(task: Task, low: float, high: float, rows: Array) -> Bin:
    errors = rows[:, 1:3] - (task.target.phase_margin, task.target.crossover)
    bound = rms_of(rows[:, 5:]) if len(rows) else np.full(2, np.nan)
    pm, fc = (Accuracy.of(errors[:, i], float(bound[i])) for i in (0, 1))
    stable, trusted = rows[:, 3:5].sum(axis=0).astype(int).tolist()
    return Bin(low, high, len(rows), len(rows) - stable, trusted, pm, fc)


def price(
    name: str,
    tuner: Tuner,
    v_x: float,
    *,
    episodes: int,
    seed: int = 0,
    progress: Progress | None = None,
) -> Price:
    """Vehicles that are slower and faster than the claimed `v_x` [m/s]."""
    task = Task(prior=Prior(v_x=(v_x, v_x)))
    cells: list[Cell] = []
    for i, error in enumerate(SPEED.levels):
        cells += measure({name: tuner}, task, SPEED, error, episodes, seed)
        if progress is not None:
            progress(f"{name}, wrong speed at {v_x:g} m/s", i + 1, len(SPEED.levels))
    return Price(name, v_x, cells)
