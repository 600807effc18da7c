"""Speed that is known but varies: the gain schedule, accuracy against speed, a wrong speed.

The schedule kp(v_x), Ti(v_x) are the gains that one tuner for all speeds finds in one
recording at each speed, beside those of the design rule that knows the vehicle.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from studies.bounds import bound_on
from studies.conditions import SPEED
from studies.draws import draw, recorded
from studies.metrics import rms
from studies.off_design import Accuracy, Cell, answered, measure
from tuners import Tuner
from yawrate_env import validation
from yawrate_env.plant.plant import Plant
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


def vehicles(plant: Plant) -> list[tuple[float, float]]:
    """(mu_s, M_delta) in the middle of the prior and at its four corners."""
    mu_s, M_delta, _ = plant.middle[0].tolist()
    return [(mu_s, M_delta), *product(plant.prior["mu_s"], plant.prior["M_delta"])]


def schedule(
    tuner: Tuner, mu_s: float, M_delta: float, speeds: Sequence[float], seed: int = 0
) -> Schedule:
    """Tune one vehicle from one recording at each speed [m/s]."""
    plant, count = tuner.plant, len(speeds)
    theta = np.stack([np.full(count, mu_s), np.full(count, M_delta), np.array(speeds)], axis=1)
    drawn = replace(draw(plant, "test", seed, 0, count), theta=theta)
    gains, _ = tuner.assess(recorded(plant, drawn))
    metrics = plant.evaluation(theta, gains.values)[0][:, :2]
    columns = np.stack([gains.values, plant.oracle(theta), metrics]).transpose(0, 2, 1)
    (kp, Ti), (oracle_kp, oracle_Ti), (margin, crossover) = columns.tolist()
    return Schedule(
        mu_s, M_delta, list(speeds), kp, Ti, oracle_kp, oracle_Ti, margin, crossover
    )  # fmt: skip


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
    plant, parts = tuner.plant, []
    for first in range(0, episodes, _CHUNK):
        drawn = draw(plant, "test", seed, first, min(_CHUNK, episodes - first))
        answers = answered(tuner, recorded(plant, drawn), plant, drawn.theta)
        bound = bound_on(plant, "test", seed, len(answers), first)
        parts.append(np.column_stack([drawn.theta[:, 2], answers, bound]))
        if progress is not None:
            progress("accuracy against speed", first + len(answers), episodes)
    rows = np.concatenate(parts)
    index = np.digitize(rows[:, 0], edges[1:-1])
    return [
        _bin(plant, low, high, rows[index == i])
        for i, (low, high) in enumerate(zip(edges[:-1], edges[1:], strict=True))
    ]


def _bin(plant: Plant, low: float, high: float, rows: Array) -> Bin:
    errors = rows[:, 1:3] - plant.targets(plant.middle)
    bound = rms(rows[:, 5:]) if len(rows) else np.full(2, np.nan)
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
