"""Training and calibration from a plant's description alone."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.features import FirstStage, compressor
from tuners.features.laguerre import Laguerre
from tuners.features.regularised import Regularised
from tuners.learners.feedforward import FeedForwardSettings
from tuners.trust.black_box import functions_for, suited, suited_to_any_input
from tuners.trust.checks import Assessment, conformal
from tuners.tuner.plant_tuner import PlantTuner
from tuners.tuner.stages import Recipe, Stages, checked, trained
from yawrate_env import validation
from yawrate_env.plant.entry import find
from yawrate_env.plant.episodes import Episodes, Examples, designed, episodes, examples
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.task import Task

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]
Answer = Callable[[Episodes], tuple[Array, Assessment]]

ORDER, MORE = 8, 24
CALIBRATION = 500
LEAST_PLANTS = 50


def recipe_for(plant: Plant) -> Recipe:
    """`compressor_for` the plant, a small network, fresh noise; for more inputs more plants."""
    learner = FeedForwardSettings(neurons=16, max_fail=10, epochs=300)
    count = 1000 if plant.excite is None else 2000
    return Recipe(compressor_for(plant), learner, noise_draws=6, vehicles=count)


def compressor_for(plant: Plant) -> Laguerre | Regularised:
    """Laguerre features with a pole that suits the plant.

    What a few functions leave out of one input a network learns; where every episode has an
    input of its own it takes more functions, which the prior holds together.
    """
    most = len(plant.u) // 10
    if plant.excite is None:
        return suited(plant, min(ORDER, most))
    return suited_to_any_input(plant, min(MORE, most))


def compressor_named(plant: Plant, name: str, **settings: Any) -> FirstStage:
    """A first stage by name; ``laguerre`` is `compressor_for` the plant, but for `settings`."""
    if name != "laguerre":
        return compressor(name, **settings)
    suited = compressor_for(plant)
    if not settings:
        return suited
    return compressor(name, **{"order": suited.order, "pole": suited.pole, **settings})


def fit(
    plant: Plant,
    recipe: Recipe,
    *,
    count: int | None = None,
    seed: int = 0,
    name: str = "custom",
    data: Examples | None = None,
    progress: Progress | None = None,
) -> tuple[Stages, dict[str, Any]]:
    """Simulate the ``train`` set, compress it, and train the second stage on it.

    Parameters
    ----------
    count : int, optional
        Simulated plants, the recipe's if not given; 80 % train, the rest validate.
    seed : int
        Of the data and of the learner.
    name : str
        What the recipe is called.
    data : Examples, optional
        Examples already simulated with this compressor, instead of new.
    progress : callable, optional
        Called with what is being done, how far it is, and how far it goes.

    Returns
    -------
    Stages
    dict
        How they were trained, for the record.
    """
    count = recipe.vehicles if count is None else count
    count = validation.count("episodes", count, at_least=LEAST_PLANTS, remedy="Simulate more.")
    seed = validation.count("seed", seed, at_least=0)

    def report(what: str) -> Callable[[int, int], None] | None:
        return None if progress is None else lambda done, of: progress(what, done, of)

    if data is None:
        data = examples(
            plant,
            count,
            seed,
            recipe.compressor,
            noise_draws=recipe.noise_draws,
            progress=report("simulating"),
        )
    stages, used = trained(
        recipe,
        data.number,
        data.features,
        data.targets(plant.parametrisation),
        data.usable,
        seed,
        report(f"training {name}"),
    )
    return stages, {
        "name": name,
        "vehicles": int(data.number.max()) + 1,
        "noise_draws": recipe.noise_draws,
        "used": used,
        "seed": seed,
        "context": "train",
    }


def train(
    plant: Plant | str,
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
    plant : Plant or str
        The plant, or where it is found: ``"module:attribute"``.
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
    check_calibration(calibration)
    plant = described(plant)
    recipe = recipe_for(plant) if recipe is None else checked(recipe)
    designed(plant)
    stages, training = fit(
        plant, recipe, count=count, seed=seed, name="two-stage", progress=progress
    )
    return finished(plant, stages, training, calibration, seed, progress)


def described(plant: Plant | str) -> Plant:
    """The plant, or that of an entry; ``ValueError`` for anything else, vehicles say."""
    if isinstance(plant, Task):
        raise ValueError("plant is a Task, of vehicles. Use tuners.train for these.")
    if not isinstance(plant, Plant | str):
        raise ValueError(f"plant = {plant!r} is neither a tuners.plants.Plant nor its entry "
                         '"module:attribute". Describe one.')  # fmt: skip
    return find(plant)


def check_calibration(calibration: int) -> None:
    """``ValueError`` for a number of episodes that calibrates nothing, before any work."""
    if calibration:
        validation.count("calibration", calibration, at_least=50, remedy="Simulate more.")


def finished(
    plant: Plant,
    stages: Stages,
    training: dict[str, Any],
    calibration: int,
    seed: int,
    progress: Progress | None = None,
) -> PlantTuner:
    """Trained stages and what they were trained for as a tuner, calibrated."""
    tuner = PlantTuner(plant, stages, functions_for(plant), training)
    if calibration:
        calibrate(tuner, calibration, seed, progress)
    return tuner


def calibrate(tuner: PlantTuner, count: int, seed: int, progress: Progress | None = None) -> None:
    """Set the tuner's `calibration` from episodes of the ``calibration`` set."""

    def answer(block: Episodes) -> tuple[Array, Assessment]:
        return tuner.assess(block.u, block.y, block.theta)

    factors = calibrated(
        tuner.plant,
        assessed(tuner.plant, "calibration", count, seed, answer),
        None if progress is None else lambda done: progress("calibrating", done, count),
    )
    tuner.calibration = tuple(factors.tolist())
    tuner.training["calibration"] = count


def assessed(
    plant: Plant, name: str, count: int, seed: int, answer: Answer
) -> Iterator[tuple[Episodes, Assessment, Array]]:
    """Episodes of a set, what a tuner's assessment says of each, and what is true.

    Parameters
    ----------
    answer : callable
        Episodes to gains (B, k) and their assessment.

    Yields
    ------
    Episodes
    Assessment
    (B, f) float64
        Figures with the true plants; ``nan`` if unstable.
    """
    for block in episodes(plant, name, seed, 0, count):
        gains, found = answer(block)
        yield block, found, plant.metric_values(block.theta, gains)


def calibrated(
    plant: Plant,
    rows: Iterator[tuple[Episodes, Assessment, Array]],
    progress: Callable[[int], None] | None = None,
) -> Array:
    """Conformal factors (f,) from what `assessed` yields.

    Plants that no gains suit ask for no interval and are left out; an unstable loop is
    outside any.
    """
    parts, done = [], 0
    for block, found, actual in rows:
        asked = np.isfinite(plant.oracle(block.theta)).all(axis=1)
        parts.append(np.stack([found.metrics, found.spread, actual])[:, asked])
        done += len(block)
        if progress is not None:
            progress(done)
    predicted, spread, actual = np.concatenate(parts, axis=1)
    factors = conformal(predicted, spread, actual)
    if not np.isfinite(factors).all():
        lost = np.isnan(actual).any(axis=1).sum()
        raise ValueError(
            f"{lost} of {len(actual)} loops that calibrate the intervals are unstable or have no "
            "gains, at most a tenth may be, of ten or more. Train on more plants, or narrow the "
            "prior."
        )
    return factors
