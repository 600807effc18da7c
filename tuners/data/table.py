"""Features and gains as one table, in the form that scikit-learn's loaders return."""

import os
from typing import Any

import numpy as np

from tuners.data import shards
from tuners.data.columns import Columns, coordinate_names, features_in
from tuners.data.folder import Folder
from tuners.data.manifest import Configuration, Shard
from tuners.features.laguerre import Laguerre
from yawrate_env import validation
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

EPISODES = 1500
"""How many are simulated where no folder is given."""

_DESCRIPTION = """Controllers of {plant} from identification episodes

{rows} plants of its prior, set {set}, seed {seed}.
Features: {features} fitted to each plant's noisy recording.
Targets: {targets}, of the design rule that knows the plant.
Plants that it finds none for, or that miss the target, are left out.

After Dettu, Lakshminarayanan, Formentin and Rojas, From data to control: a two-stage
simulation-based approach.
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
    parametrisation: str = "gains",
    return_X_y: bool = False,
    as_frame: bool = False,
) -> Any:
    """Load a regression problem: from an episode's features to its plant's gains.

    Parameters
    ----------
    folder : path, optional
        A data set that `generate` wrote; without one 1500 vehicles are simulated, always
        the same, which takes a second.
    parametrisation : {"gains", "plant"}
        Targets: the gains, or the plant's coordinates.
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
    validation.one_of("parametrisation", parametrisation, ("gains", "plant"))
    recipe, columns = _columns(folder)
    targets = recipe.plant.gains if parametrisation == "gains" else coordinate_names(recipe.plant)
    feature_names = features_in(columns)
    data, target = (
        np.stack([columns[name][columns["usable"]] for name in names], axis=1)
        for names in (feature_names, targets)
    )
    frame = None
    if as_frame:
        import pandas

        frame = pandas.DataFrame(
            np.concatenate([data, target], axis=1), columns=[*feature_names, *targets]
        )
        data, target = frame[feature_names], frame[list(targets)]
    if return_X_y:
        return data, target
    description = _DESCRIPTION.format(
        plant=recipe.plant.entry, rows=len(data), set=recipe.set, seed=recipe.seed,
        features=recipe.features, targets=", ".join(targets),
    )  # fmt: skip
    return Bunch(
        data=data,
        target=target,
        frame=frame,
        feature_names=feature_names,
        target_names=list(targets),
        DESCR=description,
    )


def _columns(folder: str | os.PathLike[str] | None) -> tuple[Configuration, Columns]:
    if folder is None:
        plant = yaw_rate(Task())
        recipe = Configuration(plant, "train", Laguerre(), 0, EPISODES, EPISODES, False)
        return recipe, shards.columns(recipe, Shard("", 0, EPISODES))
    found = Folder(folder)
    parts = list(found.columns())
    return found.recipe, {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}
