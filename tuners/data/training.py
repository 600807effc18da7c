"""Train a two-stage tuner from a data set's folder, in the memory that a part of it takes."""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.catalogue import RECIPES, TRAINING_SEED
from tuners.data.folder import Folder, verify
from tuners.data.manifest import DatasetError
from tuners.plants.coordinates import Coordinates
from tuners.stages import LEAST_USABLE, Stages, trains
from tuners.two_stage import TwoStage
from tuners.yaw_rate import yaw_rate
from yawrate_env import validation

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]


def train(
    name: str,
    dataset: str | os.PathLike[str],
    *,
    seed: int = TRAINING_SEED,
    progress: Progress | None = None,
) -> TwoStage:
    """Train one of `tuners.RECIPES` from a folder that `generate` wrote.

    The same split, scaling and method as `tuners.train` has.  The network comes out the
    same to rounding: Levenberg and Marquardt's equations are summed part by part, exactly.
    Trees read the features from disk through xgboost's external memory.

    Parameters
    ----------
    dataset : path
        The folder; its compressor must be the recipe's.
    seed : int
        Of the split and the learner; 80 % of the vehicles train, the rest validate.
    progress : callable, optional
        Called with what is being done, how far it is, and how far it goes.
    """
    recipe = RECIPES[validation.one_of("tuner", name, tuple(RECIPES))]
    validation.count("seed", seed, at_least=0)
    folder = Folder(dataset)
    if folder.recipe.compressor != recipe.compressor:
        raise DatasetError(
            f"{dataset} has features of {folder.recipe.compressor}, {name} works on those of "
            f"{recipe.compressor}. Generate a data set with that compressor."
        )
    verify(dataset, progress=progress)
    part = trains(len(folder), seed)
    plant = yaw_rate(folder.recipe.task, recipe.coordinates)
    training, checking = (Part(folder, p, plant.coordinates) for p in (part, ~part))
    used = [sum(len(X) for X, _ in batches) for batches in (training, checking)]
    if min(used) == 0 or sum(used) < LEAST_USABLE:
        raise DatasetError(
            f"{sum(used)} of {len(folder)} episodes are usable, at least {LEAST_USABLE} are "
            "needed, for training and for validation. Choose a target that a PI can reach, or "
            "generate more."
        )

    def report(done: int, of: int) -> None:
        if progress is not None:
            progress(f"training {name}", done, of)

    learner = recipe.learner.fit_batches(training, checking, seed, report)
    record = {
        "name": name,
        "vehicles": len(folder),
        "noise_draws": 1,
        "used": sum(used),
        "seed": seed,
        "context": folder.recipe.contexts.name,
    }
    stages = Stages(recipe.compressor, learner)
    return TwoStage(folder.recipe.task, stages, recipe.coordinates, record)


@dataclass(frozen=True, slots=True)
class Part:
    """Usable features and targets of some vehicles, read again at every iteration."""

    folder: Folder
    chosen: NDArray[np.bool_]
    coordinates: Coordinates

    def __iter__(self) -> Iterator[tuple[Array, Array]]:
        for rows in self.folder.batches():
            wanted = rows.usable & self.chosen[rows.number]
            if wanted.any():
                yield rows.features[wanted], rows.targets(self.coordinates)[wanted]
