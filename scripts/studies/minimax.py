"""Second stages trained for the worst case over the prior, beside those trained for the mean.

The same features and the same polynomial are fitted twice: for the least mean risk over 64 parts of
the prior, eight of friction by eight of mass, and for the least largest one
(`studies.minimax_fit`).  Errors are root mean squares over all test episodes, and over those of the
worst part.  What is minimised is the distance of the reward, 1 for 10 degrees or 0.25 Hz.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.bounds import bound_on
from studies.draws import draw
from studies.markdown import short, table
from studies.metrics import rms
from studies.minimax_fit import Minimax
from studies.rows import BATCH
from tuners import RECIPES, Tuner, load
from tuners.tuner.evaluation import Policy, evaluate
from tuners.tuner.examples import examples
from tuners.tuner.stages import Stages
from yawrate_env.batch import take
from yawrate_env.plant.pi_loop import CROSSOVER_SCALE, PHASE_SCALE
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

Array = NDArray[np.float64]
Row = dict[str, Any]
Progress = Callable[[str, int, int], None]

NOISE_DRAWS, PARTS = 4, 8
LEARNERS = {
    f"{text}, {aim}": Minimax(degree, rounds)
    for text, degree in (("quadratic", 2), ("cubic", 3))
    for aim, rounds in (("least mean", 1), ("minimax", 300))
}
SCALES = PHASE_SCALE, CROSSOVER_SCALE
_STEP = 1e-5  # of coordinates

HEADS = (
    "features", "second stage", "phase margin rms [°]: all", "worst part",
    "crossover rms [Hz]: all", "worst part", "distance rms × 1000: all", "worst part", "unstable",
)  # fmt: skip


def study(episodes: int, seed: int = 0, progress: Progress | None = None) -> list[Row]:
    """A row for the bound and for every tuner."""
    plant = yaw_rate(Task())
    parts = parts_of(plant, draw(plant, "test", seed, 0, episodes).theta)
    rows = [_row("–", "Cramér–Rao bound", bound_on(plant, "test", seed, episodes), parts)]
    for features, name, tuner in _players(plant, seed, progress):
        (found,) = evaluate(
            {name: tuner}, plant, "test", episodes=episodes, seed=seed, batch=BATCH
        )  # fmt: skip
        rows.append(_row(features, name, found.errors, parts, int((~found.stable).sum())))
    return rows


def parts_of(plant: Plant, theta: Array) -> NDArray[np.intp]:
    """Which part (B,) of the prior's friction and mass plants (B, p) are in."""
    low, high = (ends[plant.unknown] for ends in plant.ranges)
    share = (theta[:, plant.unknown] - low) / (high - low)
    index = np.clip((PARTS * share).astype(np.intp), 0, PARTS - 1)
    return np.asarray(PARTS * index[:, 0] + index[:, 1])


def slopes_of(plant: Plant, theta: Array, targets: Array) -> Array:
    """Derivatives (B, f, t) of the metrics to coordinates, in the scales of the reward."""
    columns = []
    for i in range(targets.shape[1]):
        step = np.zeros(targets.shape[1])
        step[i] = _STEP
        ends = (
            plant.metric_values(theta, plant.parametrisation.decode(targets + sign * step))
            for sign in (1, -1)
        )
        upper, lower = ends
        columns.append((upper - lower) / (2 * _STEP))
    return np.asarray(np.stack(columns, axis=2) / np.array(SCALES)[:, None])


def to_json(rows: Sequence[Row], episodes: int, seed: int = 0) -> str:
    """Rows and the conditions they hold for."""
    conditions = {"episodes": episodes, "seed": seed, "noise_draws": NOISE_DRAWS, "parts": PARTS**2}
    return json.dumps({"conditions": conditions, "rows": list(rows)}, indent=1) + "\n"


def to_markdown(rows: Sequence[Row]) -> str:
    """The table."""
    return table(HEADS, [
        (r["features"], r["name"], *(short(v) for pair in r["rms"] for v in pair), r["unstable"])
        for r in rows
    ])  # fmt: skip


def _players(
    plant: Plant, seed: int, progress: Progress | None
) -> Iterator[tuple[str, str, Policy]]:
    yield "–", "`gb`", load("gb")
    for features, name in (("Laguerre", "ts-ff-lag"), ("ARMAX at 25 Hz", "ts-ff")):
        recipe = replace(RECIPES[name], noise_draws=NOISE_DRAWS)
        report = None if progress is None else _named(progress, f"simulating, {features}")
        data = examples(
            plant, recipe.episodes, seed, recipe.features, noise_draws=NOISE_DRAWS, progress=report
        )
        yield features, f"`{name}`", load(name)
        used = take(data, np.flatnonzero(data.usable))
        targets = used.targets(plant.parametrisation)
        slopes, cells = slopes_of(plant, used.theta, targets), parts_of(plant, used.theta)
        for text, settings in LEARNERS.items():
            learner = settings.fit(used.features, targets, slopes, cells)
            yield features, text, Tuner(plant, Stages(recipe.features, learner), {"name": text})


def _named(progress: Progress, name: str) -> Callable[[int, int], None]:
    return lambda done, of: progress(name, done, of)


def _row(
    features: str, name: str, errors: Array, parts: NDArray[np.intp], unstable: int = 0
) -> Row:
    distance = np.linalg.norm(errors / np.array(SCALES), axis=1, keepdims=True)
    errors = np.concatenate([errors, 1000 * distance], axis=1)
    worst = np.max([rms(errors[parts == part]) for part in np.unique(parts)], axis=0)
    both = np.stack([rms(errors), worst], axis=1)
    values = [[float(f"{v:.4g}") for v in pair] for pair in both]
    return {"features": features, "name": name, "rms": values, "unstable": unstable}
