"""How far every tuner is above the Cramer-Rao bound, on episodes that nothing learned from.

A tuner's figure is the root mean square of its error from the target; the bound's is the
root mean square over the same vehicles and inputs.  Intervals come from resampling
episodes, error and bound together.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.metrics import bootstrap_interval, ratio_of_rms
from tuners.catalogue import RECIPES, load, train
from tuners.features.laguerre import Laguerre
from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.gbm import GBMSettings
from tuners.trust.vehicle_bound import cramer_rao
from tuners.tuner.evaluation import evaluate
from tuners.tuner.gray_box import GrayBox
from tuners.tuner.stages import Recipe
from tuners.tuner.tuner import Tuner
from yawrate_env.batch import concatenate
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.task import Experiment, Prior, Task

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

RANDOM = Recipe(
    Laguerre(order=16, pole=12.0),
    FeedForwardSettings(neurons=16, max_fail=10, epochs=400),
    noise_draws=12,
)
"""For random registers, where what a basis leaves out is noise too: more functions."""

TREES = Recipe(
    Laguerre(order=8, pole=12.0),
    GBMSettings(n_estimators=3000, max_depth=6, max_leaves=0, learning_rate=0.05),
    noise_draws=12,
)
"""Boosted trees on Laguerre features and nothing else."""

MANY = 40_000

_BATCH = 256


@dataclass(frozen=True, slots=True)
class Entry:
    """One tuner under one condition.

    Attributes
    ----------
    tuner, condition, learned_from : str
        Which, where, and from how many simulated vehicles.
    episodes : int
        Of the test.
    rms, bound, ratio : tuple of float
        Of phase_margin [deg] and crossover [Hz]; the ratio is rms over bound.
    intervals : tuple of (float, float)
        95 % of each ratio.
    unstable : int
        Loops.
    """

    tuner: str
    condition: str
    learned_from: str
    episodes: int
    rms: tuple[float, float]
    bound: tuple[float, float]
    ratio: tuple[float, float]
    intervals: tuple[tuple[float, float], tuple[float, float]]
    unstable: int


def entry(
    name: str, tuner: Tuner, condition: str, learned: str, episodes: int,
    progress: Progress | None = None,
) -> Entry:  # fmt: skip
    """Evaluate on the first `episodes` of the ``test`` set of the tuner's own task."""
    task, test = tuner.task, CONTEXT_SETS["test"]

    def report(done: int, of: int) -> None:
        if progress is not None:
            progress(f"{name}, {condition}", done, of)

    found = evaluate(
        {name: tuner}, task, test, episodes=episodes, seed=0, batch=_BATCH, progress=report
    )[0]
    target = np.array([task.target.phase_margin, task.target.crossover])
    errors = np.stack([found.phase_margin, found.crossover], axis=1) - target
    draws = [
        test.draw(task.prior, 0, first, min(_BATCH, episodes - first))
        for first in range(0, episodes, _BATCH)
    ]
    least = np.concatenate([cramer_rao(task, draw) for draw in draws])
    assert len(concatenate(draws)) == len(errors)
    pairs = [np.stack([errors[:, k], least[:, k]], axis=1) for k in (0, 1)]
    low_high = [bootstrap_interval(pair, ratio_of_rms) for pair in pairs]
    rms, bound = (np.sqrt((values**2).mean(axis=0)) for values in (errors, least))
    return Entry(
        name, condition, learned, episodes, _pair(rms), _pair(bound), _pair(rms / bound),
        (low_high[0], low_high[1]), int((~found.stable).sum()),
    )  # fmt: skip


def run(
    episodes: int, close: int, many: int = MANY, progress: Progress | None = None
) -> list[Entry]:
    """Everything that the results page claims of accuracy.

    Parameters
    ----------
    episodes, close : int
        Of the test, and where a ratio is close to one.
    many : int
        Simulated vehicles for the boosted trees that get as many as it takes.
    """
    task = Task()
    anywhere = Task(experiment=Experiment(register="random"))
    speeds = Task(prior=Prior(v_x=RECIPES["ts-ff-lag-vx"].v_x))
    fixed, varied, every = "same excitation", "random register", "10 to 33 m/s"
    vehicles = f"{RECIPES['ts-ff-lag'].vehicles} × 12 draws"
    alone = "ts-gbm-lag without its trend"
    shown = RECIPES["ts-ff-lag-vx"]
    return [
        entry("gb", GrayBox(task), fixed, "–", close, progress),
        entry("ts-ff-lag", load("ts-ff-lag"), fixed, vehicles, episodes, progress),
        entry("ts-ff-lag", load("ts-ff-lag"), fixed, vehicles, close, progress),
        entry("gb", GrayBox(anywhere), varied, "–", episodes, progress),
        entry(
            "ts-ff-lag, 16 functions", train(RANDOM, anywhere, progress=progress),
            varied, vehicles, episodes, progress,
        ),
        entry("gb", GrayBox(speeds), every, "–", episodes, progress),
        entry(
            "ts-ff-lag-vx", load("ts-ff-lag-vx"), every,
            f"{shown.vehicles} × {shown.noise_draws} draws", close, progress,
        ),
        entry("ts-gbm-lag", load("ts-gbm-lag"), fixed, vehicles, episodes, progress),
        entry(alone, train(TREES, task, progress=progress), fixed, vehicles, episodes, progress),
        entry(
            alone, train(replace(TREES, noise_draws=2), task, episodes=many, progress=progress),
            fixed, f"{many} × 2 draws", episodes, progress,
        ),
    ]  # fmt: skip


def to_json(rows: Sequence[Entry]) -> str:
    """The same for programs."""
    return json.dumps([asdict(row) for row in rows], indent=1) + "\n"


def to_markdown(rows: Sequence[Entry]) -> str:
    """The table."""
    lines = [
        "| tuner | condition | simulated vehicles | test episodes | phase margin rms [°] "
        "| × bound (95 %) | crossover rms [Hz] | × bound (95 %) | unstable |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        ratios = [
            f"{ratio:.3f} ({low:.3f} to {high:.3f})"
            for ratio, (low, high) in zip(row.ratio, row.intervals, strict=True)
        ]
        lines.append(
            f"| `{row.tuner}` | {row.condition} | {row.learned_from} | {row.episodes} "
            f"| {row.rms[0]:.5f} | {ratios[0]} | {row.rms[1]:.6f} | {ratios[1]} | {row.unstable} |"
        )
    return "\n".join(lines) + "\n"


def _pair(values: Any) -> tuple[float, float]:
    return float(values[0]), float(values[1])
