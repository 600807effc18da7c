"""Columns of numbers with names and units: what every format's reader gives."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class LogError(ValueError):
    """A recording that cannot be used."""


class MissingParameterError(LogError):
    """A measured parameter that the tuner needs is neither in the file nor given."""


class SelectionError(ValueError):
    """A choice of columns or of a stretch that this recording does not have."""


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """One recorded quantity.

    Attributes
    ----------
    values : NDArray
        (N,) float64, ``nan`` where a sample is missing.
    unit : str
        As the file states it; empty if it does not.
    time : NDArray or None
        (N,) its own time stamps [s], in formats where every quantity has some.
    notes : tuple of str
        What had to be assumed, in words.
    clock : bool
        Whether the values are times of day or dates [s].
    """

    values: Array
    unit: str = ""
    time: Array | None = None
    notes: tuple[str, ...] = ()
    clock: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """A recording before anybody knows which column is which.

    Attributes
    ----------
    names : tuple of str
        Of the columns, in the file's order.
    column : callable
        Reads one by its name; `LogError` where it does not hold numbers.
    notes : tuple of str
        What was remarkable about the file, in words.
    source : Path
        The file.
    """

    names: tuple[str, ...]
    column: Callable[[str], Column]
    notes: tuple[str, ...] = ()
    source: Path = Path()
