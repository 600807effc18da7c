"""A plant's recording from a log file in any format that `tuners.logs` reads."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tuners.logs.columns import recognised
from tuners.logs.formats import read_table
from tuners.logs.table import LogError
from tuners.plants.plant import Plant

Array = NDArray[np.float64]

_EVEN = 0.02  # of a sampling time


def read(path: Path, plant: Plant) -> tuple[Array, Array]:
    """Input and output (N,) of a log whose columns are called as the plant's signals, or u and y.

    A time column must have the plant's sampling time; without one it is taken for granted.
    """
    table = read_table(path)
    names = {_plain(name): name for name in reversed(table.names)}
    values = []
    for signal, short in zip(plant.signals, "uy", strict=True):
        name = names.get(_plain(signal)) or names.get(short)
        if name is None:
            raise LogError(
                f"{path}: no column is called {signal!r} or {short}; there are "
                f"{', '.join(table.names)}. Rename one."
            )
        values.append(table.column(name).values)
    clock = recognised("time", table.names)
    if clock is not None:
        steps = np.diff(table.column(clock).values)
        if not np.all(np.abs(steps - plant.Ts) <= _EVEN * plant.Ts):
            raise LogError(
                f"{path}: time steps run from {steps.min():g} to {steps.max():g} s, the plant's "
                f"sampling time is {plant.Ts:g} s. Resample the log."
            )
    return values[0], values[1]


def _plain(signal: str) -> str:
    """A name without its unit, in lower case."""
    return re.sub(r"[\[(].*?[\])]", "", signal).strip().lower()
