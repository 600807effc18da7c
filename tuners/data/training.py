"""Train a two-stage tuner from a data set's folder, in the memory that a part of it takes."""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.catalogue import TRAINING_SEED, named
from tuners.data.folder import Folder, check
from tuners.data.manifest import DatasetError, differences
from tuners.tuner.plant_tuner import PlantTuner
from tuners.tuner.stages import LEAST_USABLE, Recipe, Stages, checked, trains
from tuners.tuner.training import CALIBRATION, check_calibration, described, finished, recipe_for
from tuners.tuner.two_stage import TwoStage
from yawrate_env import validation
from yawrate_env.plant.parametrisation import Coordinates
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

HELD_OUT = ("test", "calibration")
"""Sets that tell how good a tuner is, from which nothing may learn."""


def train(
    tuner: str | Recipe,
    dataset: str | os.PathLike[str],
    *,
    task: Task | None = None,
    seed: int = TRAINING_SEED,
    name: str | None = None,
    progress: Progress | None = None,
) -> TwoStage:
    """Train a two-stage tuner from a folder of vehicles that `generate` wrote.

    The same split, scaling and method as `tuners.train` has.  The network comes out the
    same to rounding: Levenberg and Marquardt's equations are summed part by part, exactly.
    Trees read the features from disk through xgboost's external memory.

    Parameters
    ----------
    tuner : str or Recipe
        One of `tuners.RECIPES`, or any other.
    dataset : path
        The folder; its compressor must be the recipe's.
    task : Task, optional
        What the folder must be of; it holds one itself.
    seed : int
        Of the split and the learner; 80 % of the vehicles train, the rest validate.
    name : str, optional
        What the record calls it; its name in `tuners.RECIPES`, or else ``"custom"``.
    progress : callable, optional
        Called with what is being done, how far it is, and how far it goes.
    """
    known, recipe = named(tuner)
    validation.count("seed", seed, at_least=0)
    folder = Folder(dataset)
    found = folder.recipe.what
    if not isinstance(found, Task):
        raise DatasetError(f"{dataset} holds no vehicles. Use tuners.data.train_plant.")
    if task is not None:
        _check_same(folder, task)
    coordinates = yaw_rate(found, recipe.coordinates).parametrisation
    stages, training = fit(folder, name or known, recipe, coordinates, seed, progress)
    return TwoStage(found, stages, recipe.coordinates, training)


def _check_same(folder: Folder, task: Task) -> None:
    """`DatasetError` where a folder is of other vehicles."""
    wanted = replace(folder.recipe, what=task).to_json()
    other = "; ".join(differences(wanted, folder.recipe.to_json()))
    if other:
        raise DatasetError(
            f"{folder.path} holds other vehicles: {other}. Generate a data set of these, or leave "
            "them out: the folder says what it is of."
        )


def train_plant(
    dataset: str | os.PathLike[str],
    recipe: Recipe | None = None,
    *,
    plant: Plant | str | None = None,
    seed: int = TRAINING_SEED,
    calibration: int = CALIBRATION,
    progress: Progress | None = None,
) -> PlantTuner:
    """Train a plant's tuner from a folder that `generate` wrote, and calibrate its intervals.

    As `tuners.plants.train` does with one recording of every plant; the intervals' episodes
    are simulated.

    Parameters
    ----------
    dataset : path
        The folder.
    recipe : Recipe, optional
        Its compressor must be the folder's; by default that, and `recipe_for`'s learner.
    plant : Plant or str, optional
        As for `Folder`, or where it is found.
    seed : int
        Of the split, the learner and the calibration; 80 % of the plants train.
    calibration : int
        Episodes that calibrate the intervals; 0 leaves those of a normal error.
    progress : callable, optional
        Called with what is being done, how far it is, and how far it goes.
    """
    validation.count("seed", seed, at_least=0)
    check_calibration(calibration)
    if recipe is not None:
        checked(recipe)
    folder = Folder(dataset, None if plant is None else described(plant))
    found = folder.recipe.what
    if not isinstance(found, Plant):
        raise DatasetError(f"{dataset} holds vehicles. Use tuners.data.train.")
    recipe = recipe or replace(recipe_for(found), compressor=folder.recipe.compressor)
    stages, training = fit(folder, "two-stage", recipe, found.parametrisation, seed, progress)
    return finished(found, stages, training, calibration, seed, progress)


def fit(
    folder: Folder,
    name: str,
    recipe: Recipe,
    coordinates: Coordinates,
    seed: int,
    progress: Progress | None = None,
) -> tuple[Stages, dict[str, Any]]:
    """Train the second stage on a folder; as `tuners.tuner.training.fit`.

    Parameters
    ----------
    name : str
        What the recipe is called.
    coordinates : Coordinates
        What the learner predicts.

    Returns
    -------
    Stages
    dict
        How they were trained, for the record.
    """
    if folder.recipe.compressor != recipe.compressor:
        raise DatasetError(
            f"{folder.path} has features of {folder.recipe.compressor}, {name} works on those of "
            f"{recipe.compressor}. Generate a data set with that compressor."
        )
    if folder.recipe.contexts.name in HELD_OUT:
        raise DatasetError(
            f"{folder.path} holds the {folder.recipe.contexts.name} set, which tells how good a "
            "tuner is: nothing may learn from it. Generate the train set."
        )
    check(folder, progress)
    part = trains(len(folder), seed)
    training, checking = (Part(folder, p, coordinates) for p in (part, ~part))
    used = [sum(len(X) for X, _ in batches) for batches in (training, checking)]
    if min(used) == 0 or sum(used) < LEAST_USABLE:
        raise DatasetError(
            f"{sum(used)} of {len(folder)} episodes are usable, at least {LEAST_USABLE} are "
            "needed, for training and for validation. Choose a target that the controller can "
            "reach, or generate more."
        )

    def report(done: int, of: int) -> None:
        if progress is not None:
            progress(f"training {name}", done, of)

    learner = recipe.learner.fit_batches(training, checking, seed, report)
    return Stages(recipe.compressor, learner), {
        "name": name,
        "vehicles": len(folder),
        "noise_draws": 1,
        "used": sum(used),
        "seed": seed,
        "context": folder.recipe.contexts.name,
    }


@dataclass(frozen=True, slots=True)
class Part:
    """Usable features and targets of some plants, read again at every iteration."""

    folder: Folder
    chosen: NDArray[np.bool_]
    coordinates: Coordinates

    def __iter__(self) -> Iterator[tuple[Array, Array]]:
        for rows in self.folder.batches():
            wanted = rows.usable & self.chosen[rows.number]
            if wanted.any():
                yield rows.features[wanted], rows.targets(self.coordinates)[wanted]
