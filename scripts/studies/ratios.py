"""How far every tuner is above the Cramer-Rao bound, on episodes that nothing learned from.

A tuner's value is the root mean square of its error from the target; the bound's is the
root mean square over the same vehicles and inputs.  Intervals come from resampling
episodes, error and bound together.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.bounds import bound_on
from studies.markdown import table
from studies.metrics import bootstrap_interval, ratio_of_rms, rms
from tuners import RECIPES, Recipe, Tuner, load, train
from tuners.catalogue import SPEEDS
from tuners.features.laguerre import Laguerre
from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.gbm import GBMSettings
from tuners.tuner.evaluation import evaluate
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

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

HEADS = (
    "tuner", "condition", "simulated vehicles", "test episodes",
    "phase margin rms [°]", "× bound (95 %)", "crossover rms [Hz]", "× bound (95 %)", "unstable",
)  # fmt: skip

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
    progress: Progress | None = None, plant: Plant | None = None,
) -> Entry:  # fmt: skip
    """Evaluate on the first `episodes` of the ``test`` set of a plant, the tuner's own if None."""
    plant = plant or tuner.plant

    def report(done: int, of: int) -> None:
        if progress is not None:
            progress(f"{name}, {condition}", done, of)

    (found,) = evaluate(
        {name: tuner}, plant, "test", episodes=episodes, seed=0, batch=_BATCH, progress=report
    )  # fmt: skip
    errors, least = found.errors, bound_on(plant, "test", 0, episodes)
    pairs = np.stack([errors, least], axis=2)
    low_high = [bootstrap_interval(pairs[:, k], ratio_of_rms) for k in (0, 1)]
    return Entry(
        name, condition, learned, episodes,
        _pair(rms(errors)), _pair(rms(least)), _pair(rms(errors) / rms(least)),
        (low_high[0], low_high[1]), int((~found.stable).sum()),
    )  # fmt: skip


def run(
    episodes: int,
    close: int,
    many: int = MANY,
    progress: Progress | None = None,
    kept: Sequence[Entry] = (),
) -> list[Entry]:
    """Everything that the results page claims of accuracy.

    Parameters
    ----------
    episodes, close : int
        Of the test, and where a ratio is close to one.
    many : int
        Simulated vehicles for the boosted trees that get as many as it takes.
    kept : sequence of Entry
        Rows of an earlier run that are not made again.
    """
    every, poly = RECIPES["ts-ff-lag-vx"], RECIPES["ts-poly-any"]
    plant = yaw_rate(Task())
    random = yaw_rate(Task(experiment=Experiment(register="random")))
    speeds = yaw_rate(Task(prior=Prior(v_x=SPEEDS["ts-ff-lag-vx"])))
    both = yaw_rate(
        Task(prior=Prior(v_x=SPEEDS["ts-poly-any"]), experiment=Experiment(register="random"))
    )
    fixed, varied, anywhere = "same excitation", "random register", "10 to 33 m/s"
    everything = f"{anywhere}, {varied}"
    vehicles = f"{RECIPES['ts-ff-lag'].episodes} × 12 draws"
    alone = "ts-gbm-lag without its trend"

    def trained(recipe: Recipe, on: Any, count: int | None = None) -> Tuner:
        return train(recipe, on, episodes=count, calibration=0, progress=progress)

    def row(
        name: str, tuner: Callable[[], Tuner], condition: str, learned: str, count: int,
        plant: Plant | None = None,
    ) -> Entry:  # fmt: skip
        for old in kept:
            if (old.tuner, old.condition, old.learned_from, old.episodes) == (
                name, condition, learned, count
            ):  # fmt: skip
                return old
        return entry(name, tuner(), condition, learned, count, progress, plant)

    def shipped(name: str) -> Callable[[], Tuner]:
        return partial(load, name)

    of_poly = f"{poly.episodes} × {poly.noise_draws} draw"
    of_every = f"{every.episodes} × {every.noise_draws} draws"
    return [
        row("gb", shipped("gb"), fixed, "–", close),
        row("ts-ff-lag", shipped("ts-ff-lag"), fixed, vehicles, episodes),
        row("ts-ff-lag", shipped("ts-ff-lag"), fixed, vehicles, close),
        row("ts-poly-any", shipped("ts-poly-any"), fixed, of_poly, episodes, plant),
        row("gb", partial(load, "gb", random), varied, "–", episodes),
        row("ts-ff-lag", shipped("ts-ff-lag"), varied, vehicles, episodes, random),
        row(
            "ts-ff-lag, 16 functions", partial(trained, RANDOM, random), varied, vehicles, episodes
        ),
        row("ts-poly-any", shipped("ts-poly-any"), varied, of_poly, episodes, random),
        row("gb", partial(load, "gb", speeds), anywhere, "–", episodes),
        row("ts-ff-lag-vx", shipped("ts-ff-lag-vx"), anywhere, of_every, close),
        row("ts-ff-lag-vx", shipped("ts-ff-lag-vx"), everything, of_every, episodes, both),
        row("ts-poly-any", shipped("ts-poly-any"), anywhere, of_poly, episodes, speeds),
        row("ts-poly-any", shipped("ts-poly-any"), everything, of_poly, episodes),
        row("ts-gbm-lag", shipped("ts-gbm-lag"), fixed, vehicles, episodes),
        row(alone, partial(trained, TREES, plant), fixed, vehicles, episodes),
        row(
            alone, partial(trained, replace(TREES, noise_draws=2), plant, many),
            fixed, f"{many} × 2 draws", episodes,
        ),
    ]  # fmt: skip


def from_json(text: str) -> list[Entry]:
    """Rows that `to_json` wrote."""
    found = []
    for row in json.loads(text):
        row |= {name: _pair(row[name]) for name in ("rms", "bound", "ratio")}
        row["intervals"] = tuple(map(_pair, row["intervals"]))
        found.append(Entry(**row))
    return found


def to_json(rows: Sequence[Entry]) -> str:
    """The same for programs."""
    return json.dumps([asdict(row) for row in rows], indent=1) + "\n"


def to_markdown(rows: Sequence[Entry]) -> str:
    """The table."""
    return table(HEADS, map(_cells, rows))


def _cells(row: Entry) -> tuple[object, ...]:
    margin, crossover = (
        f"{ratio:.3f} ({low:.3f} to {high:.3f})"
        for ratio, (low, high) in zip(row.ratio, row.intervals, strict=True)
    )
    return (
        f"`{row.tuner}`", row.condition, row.learned_from, row.episodes,
        f"{row.rms[0]:.5f}", margin, f"{row.rms[1]:.6f}", crossover, row.unstable,
    )  # fmt: skip


def _pair(values: Any) -> tuple[float, float]:
    return float(values[0]), float(values[1])
