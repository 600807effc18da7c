"""Names and units of a data set's columns.

| column | type | |
|---|---|---|
| `episode` | int64 | number within the seed |
| the prior's parameters | float64 | the plant |
| `laguerre_1`, `armax_1`, `feature_1` ... | float64 | features; measured parameters' come last |
| `usable` | bool | the features converged and the design rule reaches its target |
| the gains | float64 | of the design rule |
| the coordinates | float64 | the same gains as the learner predicts them |
| `u`, `y` | float32[N] | the recording, on request; of several inputs and outputs by their names |
"""

import re
from collections import Counter
from collections.abc import Iterable
from typing import Any

from numpy.typing import NDArray

from tuners.features import FEATURES
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant

Columns = dict[str, NDArray[Any]]

_OWN = "feature"
_FEATURE = re.compile(rf"({'|'.join((*FEATURES, _OWN))})_\d+")


def feature_names(stage: str, count: int) -> list[str]:
    """Names of the columns of a first stage's features."""
    kind = stage if stage in FEATURES else _OWN
    return [f"{kind}_{i}" for i in range(1, count + 1)]


def features_in(names: Iterable[str]) -> list[str]:
    """Names of columns that are features."""
    return [name for name in names if _FEATURE.fullmatch(name)]


def coordinate_names(plant: Plant) -> tuple[str, ...]:
    """Names of the plant's coordinates."""
    if plant.parametrisation.names is not None:
        return plant.parametrisation.names(plant.gains)
    width = plant.parametrisation.encode(plant.oracle(plant.middle)).shape[1]
    return tuple(f"coordinate_{i}" for i in range(1, width + 1))


def units(plant: Plant) -> dict[str, str]:
    """Units of the columns that have any."""
    labels = {name: plant.label(name) for name in plant.prior} | plant.columns
    found = {name: split(label)[1] for name, label in labels.items()}
    return {name: unit for name, unit in found.items() if unit}


def check(plant: Plant) -> None:
    """``ValueError`` where two columns would have one name."""
    coordinates = coordinate_names(plant)
    coordinates = () if coordinates == plant.gains else coordinates
    names = [*plant.prior, *plant.gains, *coordinates, "episode", "usable", *plant.columns]
    for name, count in Counter(names).items():
        if count > 1 or _FEATURE.fullmatch(name):
            raise ValueError(
                f"{name!r} would be the name of two columns. Rename the plant's parameter, gain, "
                "coordinate or channel."
            )
