"""Features and gains as one table, in the form that scikit-learn's loaders return."""

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.catalogue import RECIPES
from tuners.data import shards
from tuners.data.folder import Folder
from tuners.data.manifest import Configuration, Shard
from tuners.data.subject import Columns, target_names
from tuners.features.laguerre import Laguerre
from yawrate_env import validation
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.task import Task

Array = NDArray[np.float64]

_OF_VEHICLES = """Yaw-rate controllers from identification episodes

{rows} vehicles of unknown friction and mass, context set {contexts}, seed {seed}.
Features: {compressor} fitted to each vehicle's noisy response to a steering sequence.
Targets: what gives each vehicle's loop {margin:g} degrees of phase margin at {crossover:g} Hz:
{targets}.
Vehicles that no PI controller takes there are left out.

After Dettu, Lakshminarayanan, Formentin and Rojas, From data to control: a two-stage
simulation-based approach.
"""
_MEANING = {
    "gains": "proportional gain kp [s] and integral time Ti [s] of the PI controller",
    "loop": "log magnitude and phase [rad] of the PI controller at that frequency",
}
_OF_PLANTS = """Controllers of {entry} from identification episodes

{rows} plants of its prior, context set {contexts}, seed {seed}.
Features: {compressor} fitted to each plant's noisy recording.
Targets: {targets}, of the design rule that knows the plant.
Plants for which it has none are left out.
"""


class Bunch(dict[str, Any]):
    """A dictionary whose keys are attributes too, as scikit-learn's is."""

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError:
            raise AttributeError(name) from None


def load_gains(
    folder: str | os.PathLike[str] | None = None,
    *,
    coordinates: str = "gains",
    return_X_y: bool = False,
    as_frame: bool = False,
) -> Any:
    """Load a regression problem: from an episode's features to its plant's gains.

    Parameters
    ----------
    folder : path, optional
        A data set that `generate` wrote; without one 1500 vehicles are simulated, always
        the same, which takes a second.
    coordinates : {"gains", "loop", "own"}
        What to predict: gains, or for vehicles loop coordinates, for other plants their own.
    return_X_y : bool
        Return ``(data, target)`` alone.
    as_frame : bool
        As pandas objects.

    Returns
    -------
    Bunch or tuple
        ``data`` (m, n), ``target`` (m, k), ``feature_names``, ``target_names``, ``frame``
        (both side by side, or None) and ``DESCR``.
    """
    recipe, columns = _columns(folder)
    plant = recipe.plant()
    targets = {"gains": plant.gains, recipe.subject.coordinates: target_names(plant)}
    chosen = targets[validation.one_of("coordinates", coordinates, tuple(targets))]
    feature_names = shards.feature_names(columns)
    data, target = (
        np.stack([columns[name][columns["usable"]] for name in names], axis=1)
        for names in (feature_names, chosen)
    )
    frame = None
    if as_frame:
        import pandas

        frame = pandas.DataFrame(
            np.concatenate([data, target], axis=1), columns=[*feature_names, *chosen]
        )
        data, target = frame[feature_names], frame[list(chosen)]
    if return_X_y:
        return data, target
    return Bunch(
        data=data,
        target=target,
        frame=frame,
        feature_names=feature_names,
        target_names=list(chosen),
        DESCR=_described(recipe, len(data), coordinates, chosen),
    )


def _described(recipe: Configuration, rows: int, coordinates: str, targets: tuple[str, ...]) -> str:
    common = {
        "rows": rows,
        "contexts": recipe.contexts.name,
        "seed": recipe.seed,
        "compressor": recipe.compressor,
    }
    if isinstance(recipe.what, Plant):
        entry, named = recipe.what.entry, ", ".join(targets)
        return _OF_PLANTS.format(entry=entry, targets=named, **common)
    target, meaning = recipe.what.target, _MEANING[coordinates]
    loop = {"margin": target.phase_margin, "crossover": target.crossover}
    return _OF_VEHICLES.format(targets=meaning, **loop, **common)


def _columns(folder: str | os.PathLike[str] | None) -> tuple[Configuration, Columns]:
    if folder is None:
        episodes = RECIPES["ts-ff-lag"].vehicles
        train = CONTEXT_SETS["train"]
        recipe = Configuration(Task(), train, Laguerre(), 0, episodes, episodes, False)
        return recipe, shards.columns(recipe, Shard("", 0, episodes))
    found = Folder(folder)
    parts = list(found.columns())
    return found.recipe, {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}
