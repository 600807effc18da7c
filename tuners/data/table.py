"""Features and gains as one table, in the form that scikit-learn's loaders return."""

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.catalogue import RECIPES
from tuners.data import shards
from tuners.data.folder import Folder
from tuners.data.manifest import Configuration, Shard
from tuners.laguerre import Laguerre
from yawrate_env import validation
from yawrate_env.contexts import CONTEXT_SETS
from yawrate_env.task import Task

Array = NDArray[np.float64]

_DESCRIPTION = """Yaw-rate controllers from identification episodes

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
    """Load a regression problem: from an episode's features to its vehicle's gains.

    Parameters
    ----------
    folder : path, optional
        A data set that `generate` wrote; without one 1500 vehicles are simulated, always
        the same, which takes a second.
    coordinates : {"gains", "loop"}
        What to predict.
    return_X_y : bool
        Return ``(data, target)`` alone.
    as_frame : bool
        As pandas objects.

    Returns
    -------
    Bunch or tuple
        ``data`` (m, n), ``target`` (m, 2), ``feature_names``, ``target_names``, ``frame``
        (both side by side, or None) and ``DESCR``.
    """
    target_names = shards.TARGETS[
        validation.one_of("coordinates", coordinates, tuple(shards.TARGETS))
    ]
    recipe, columns = _columns(folder)
    feature_names = shards.feature_names(columns)
    data, target = (
        np.stack([columns[name][columns["usable"]] for name in names], axis=1)
        for names in (feature_names, target_names)
    )
    frame = None
    if as_frame:
        import pandas

        frame = pandas.DataFrame(
            np.concatenate([data, target], axis=1), columns=[*feature_names, *target_names]
        )
        data, target = frame[feature_names], frame[list(target_names)]
    if return_X_y:
        return data, target
    return Bunch(
        data=data,
        target=target,
        frame=frame,
        feature_names=feature_names,
        target_names=list(target_names),
        DESCR=_DESCRIPTION.format(
            rows=len(data),
            contexts=recipe.contexts.name,
            seed=recipe.seed,
            compressor=recipe.compressor,
            margin=recipe.task.target.phase_margin,
            crossover=recipe.task.target.crossover,
            targets=_MEANING[coordinates],
        ),
    )


def _columns(folder: str | os.PathLike[str] | None) -> tuple[Configuration, shards.Columns]:
    if folder is None:
        episodes = RECIPES["ts-ff-lag"].vehicles
        train = CONTEXT_SETS["train"]
        recipe = Configuration(Task(), train, Laguerre(), 0, episodes, episodes, False)
        return recipe, shards.columns(recipe, Shard("", 0, episodes))
    found = Folder(folder)
    parts = list(found.columns())
    return found.recipe, {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}
