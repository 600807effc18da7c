"""Training and calibration of a plant's tuner, from its description alone."""

from collections.abc import Callable

import numpy as np

from tuners.catalogue import LEAST_USABLE
from tuners.datasets import trains
from tuners.feedforward import FeedForwardSettings
from tuners.plants.black_box import suited
from tuners.plants.data import episodes, examples
from tuners.plants.plant import Plant
from tuners.plants.tuner import PlantTuner
from tuners.trust import conformal
from tuners.two_stage import Recipe
from yawrate_env import validation

Progress = Callable[[str, int, int], None]

ORDER, BLACK_BOX_ORDER = 8, 16
CALIBRATION = 500


def recipe_for(plant: Plant) -> Recipe:
    """Laguerre features with a pole that suits the plant, a small network, fresh noise."""
    learner = FeedForwardSettings(neurons=16, max_fail=10, epochs=300)
    return Recipe(suited(plant, ORDER), learner, noise_draws=6, vehicles=1000)


def train(
    plant: Plant,
    recipe: Recipe | None = None,
    *,
    count: int | None = None,
    seed: int = 0,
    calibration: int = CALIBRATION,
    progress: Progress | None = None,
) -> PlantTuner:
    """Train a two-stage tuner and calibrate its intervals.

    Parameters
    ----------
    recipe : Recipe, optional
        Compressor, learner, noise draws and how many plants; `recipe_for` by default.  Its
        coordinates and speeds are the vehicle's: a plant has its own coordinates.
    count : int, optional
        Simulated plants, the recipe's if not given; 80 % train, the rest validate.
    seed : int
        Of the data and of the learner.
    calibration : int
        Episodes that calibrate the intervals; 0 leaves those of a normal error.
    progress : callable, optional
        Called with what is being done, how far it is, and how far it goes.
    """
    recipe = recipe or recipe_for(plant)
    count = validation.count(
        "count", count or recipe.vehicles, at_least=50, remedy="Simulate more."
    )
    seed = validation.count("seed", seed, at_least=0)

    def report(what: str) -> Callable[[int, int], None] | None:
        return None if progress is None else lambda done, of: progress(what, done, of)

    data = examples(
        plant,
        count,
        seed,
        recipe.compressor,
        noise_draws=recipe.noise_draws,
        progress=report("simulating"),
    )
    rows = np.flatnonzero(data.usable)
    if len(rows) < LEAST_USABLE:
        raise ValueError(
            f"{len(rows)} of {len(data)} episodes are usable, at least {LEAST_USABLE} are needed. "
            "Look at what simulate and design give over the prior, or simulate more."
        )
    part = trains(count, seed)
    fitted, checked = (rows[p[data.number[rows]]] for p in (part, ~part))
    X, T = data.features, data.targets
    learner = recipe.learner.fit(
        X[fitted], T[fitted], X[checked], T[checked], seed, report("training")
    )
    training = {
        "plants": count,
        "noise_draws": recipe.noise_draws,
        "used": len(rows),
        "seed": seed,
        "context": "train",
    }
    black_box = suited(plant, BLACK_BOX_ORDER)
    tuner = PlantTuner(plant, recipe.compressor, learner, black_box, training)
    if calibration:
        calibrate(tuner, calibration, seed, report("calibrating"))
    return tuner


def calibrate(
    tuner: PlantTuner, count: int, seed: int, progress: Callable[[int, int], None] | None = None
) -> None:
    """Set the tuner's `calibration` from episodes of the ``calibration`` set."""
    validation.count("calibration", count, at_least=50, remedy="Simulate more.")
    plant, parts, done = tuner.plant, [], 0
    for block in episodes(plant, "calibration", seed, 0, count):
        gains = tuner.gains(plant.u[None], block.y)
        found = tuner.assess(plant.u, block.y, gains)
        parts.append(np.stack([found.figures, found.spread, plant.judged(block.theta, gains)]))
        done += len(block)
        if progress is not None:
            progress(done, count)
    predicted, spread, actual = np.concatenate(parts, axis=1)
    tuner.calibration = tuple(conformal(predicted, spread, actual).tolist())
    tuner.training["calibration"] = count
