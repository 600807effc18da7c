"""Train a two-stage tuner from a data set's folder, with a part of it in memory at a time."""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.data.folder import Folder, check
from tuners.data.manifest import DatasetError
from tuners.trust.emulator import with_emulator
from tuners.tuner.against_bound import tell
from tuners.tuner.recipes import confined, recipe_for
from tuners.tuner.simulations import of_others, shown, simulating
from tuners.tuner.stages import LEAST_USABLE, Recipe, Stages, coordinates_of, training_split
from tuners.tuner.training import (
    CALIBRATION,
    check_calibration,
    finished,
    rehearse,
)
from tuners.tuner.tuner import Tuner
from yawrate_env import validation
from yawrate_env.plant.entry import find
from yawrate_env.plant.parametrisation import Parametrisation
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

HELD_OUT = ("test", "calibration")
"""Sets that measure how good a tuner is; none is trained on them."""


def train(
    path: str | os.PathLike[str],
    recipe: Recipe | None = None,
    plant: Plant | str | None = None,
    *,
    seed: int = 0,
    calibration: int = CALIBRATION,
    name: str = "two-stage",
    progress: Progress | None = None,
) -> Tuner:
    """Train a tuner from a folder that `generate` wrote, and calibrate its intervals.

    Split, scaling and method are those of `tuners.train` with one recording of every plant.
    The network comes out the same to rounding: Levenberg and Marquardt's equations are summed
    part by part, exactly.  Trees read the features from disk through xgboost's external memory.

    Parameters
    ----------
    path : path
        The folder.
    recipe : Recipe, optional
        Its features must be the folder's; by default these, and `recipe_for`'s learner.
    plant : Plant or str, optional
        As for `Folder`, or its entry.
    seed : int
        Of the split, the learner and the calibration; 80 % of the plants train.
    calibration : int
        Simulated episodes that calibrate the intervals; 0 leaves those of a normal error.
    name : str
        Name of the recipe in the record.
    progress : callable, optional
        Called with the stage's name, how far it is, and how far it goes.
    """
    validation.count("seed", seed, at_least=0)
    check_calibration(calibration)
    if recipe is not None:
        validation.instance("recipe", recipe, Recipe, remedy="Give a tuners.Recipe.")
    folder = Folder(path, None if plant is None else find(plant))
    known = folder.recipe
    recipe = recipe or replace(recipe_for(known.plant), features=known.features)
    stages, training = fit(folder, name, recipe, seed, progress)
    with shown(known.plant, progress) as bars, simulating(known.plant, progress=bars) as plant:
        tuner = finished(plant, stages, training, calibration, of_others(plant, bars))
    tuner.plant = with_emulator(known.plant, tuner.plant.emulator)
    tell(tuner)
    return tuner


def fit(
    folder: Folder, name: str, recipe: Recipe, seed: int, progress: Progress | None = None
) -> tuple[Stages, dict[str, Any]]:
    """Train the second stage on a folder; as `tuners.tuner.training.fit` does in memory.

    Returns
    -------
    Stages
    dict
        How they were trained, for the record.
    """
    found = folder.recipe
    recipe = confined(found.plant, recipe)
    if found.features != recipe.features:
        raise DatasetError(
            f"{folder.path} has features of {found.features}, {name} works on those of "
            f"{recipe.features}. Generate a data set with these features."
        )
    if found.set in HELD_OUT:
        raise DatasetError(
            f"{folder.path} holds the {found.set} set, which measures how good a tuner is: it "
            "must not train one. Generate the train set."
        )
    rehearse(found.plant, recipe)
    check(folder, progress)
    part, coordinates = (
        training_split(len(folder), seed),
        coordinates_of(found.plant, recipe.parametrisation),
    )
    training, validating = (Part(folder, p, coordinates) for p in (part, ~part))
    used = [sum(len(X) for X, _ in batches) for batches in (training, validating)]
    if min(used) == 0 or sum(used) < LEAST_USABLE:
        raise DatasetError(
            f"{sum(used)} of {len(folder)} episodes are usable, at least {LEAST_USABLE} are "
            "needed, for training and for validation. Choose a target that the controller can "
            "reach, or generate more."
        )

    def report(done: int, of: int) -> None:
        if progress is not None:
            progress(f"training {name}", done, of)

    learner = recipe.learner.fit(training, validating, seed, report)
    return Stages(recipe.features, learner, recipe.parametrisation), {
        "name": name,
        "episodes": len(folder),
        "noise_draws": 1,
        "used": sum(used),
        "seed": seed,
        "set": found.set,
    }


@dataclass(frozen=True, slots=True)
class Part:
    """Usable features and targets of some plants, read again at every iteration."""

    folder: Folder
    chosen: NDArray[np.bool_]
    coordinates: Parametrisation

    def __iter__(self) -> Iterator[tuple[Array, Array]]:
        for rows in self.folder.batches():
            used = rows.usable & self.chosen[rows.number]
            if used.any():
                yield rows.features[used], rows.targets(self.coordinates)[used]
