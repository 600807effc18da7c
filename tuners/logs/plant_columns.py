"""A plant's signals and measured parameters among a log's columns, in the plant's units.

A column is called as the plant calls what it holds.  Its unit is the user's, or else the
file's (``speed [rpm]``, ``speed_rpm``, a row of units), or else the plant's, which is in the
signal's name: ``speed [rad/s]``.  Where that has none, numbers are taken as they are.
"""

import math
import re
from dataclasses import dataclass

from tuners.logs import units
from tuners.logs.columns import Quantity
from tuners.logs.table import Column, LogError, SelectionError, Table
from yawrate_env.plant.names import split


@dataclass(frozen=True, slots=True)
class Wanted:
    """What a column is looked for, and what the user says of it.

    Attributes
    ----------
    name : str
        The signal or parameter, as the plant calls it.
    flag : str
        ``--input`` or ``--output``, which begin the flags for signals.
    unit : str
        Of the column, if not what the file says.
    scale : float
        What the column is multiplied by, once it is in the plant's unit.
    """

    name: str
    flag: str = ""
    unit: str = ""
    scale: float = 1.0


def plain(name: str) -> str:
    """A name without its unit, in lower case, in one word."""
    return re.sub(r"\[.*?\]|\(.*\)", "", name).strip().lower().replace(" ", "_")


def column_of(name: str, table: Table) -> str | None:
    """The column of this name, or else of this name and a unit."""
    exact = (column for column in table.names if plain(column) == plain(name))
    longer = (column for column in table.names if _suffix(column, name))
    return next(exact, None) or next(longer, None)


def quantity(table: Table, column: str, wanted: Wanted) -> tuple[Quantity, list[str]]:
    """A column in the plant's unit, and what was done to it."""
    read, scale = table.column(column), wanted.scale
    (factor, offset), notes = _conversion(column, read, wanted)
    if scale != 1 and notes:
        notes.append(f"Column {column} was then multiplied by {scale:g}.")
    return Quantity(column, "", scale * (factor * read.values + offset), read.time), notes


def _suffix(column: str, name: str) -> str:
    """The unit in ``speed_rpm`` for ``speed [rad/s]``; a symbol's may be an index."""
    start, unit = f"{plain(name)}_", split(name)[1]
    said = column[len(start) :]
    begins = len(start) > 2 and column.lower().startswith(start)
    return said if unit and begins and units.alike(said, unit) else ""


def _conversion(column: str, read: Column, wanted: Wanted) -> tuple[tuple[float, float], list[str]]:
    """Factor and offset to the plant's unit, and a note where there are any."""
    name, unit = split(wanted.name)
    if wanted.unit and not unit:
        raise SelectionError(
            f"{wanted.flag}-unit {wanted.unit}: the plant does not say what unit its {name} has. "
            f"Give {wanted.flag}-scale."
        )
    said = wanted.unit or units.stated(column, read.unit) or _suffix(column, wanted.name)
    if said and not unit:
        return (1.0, 0.0), [
            f"Column {column} was taken as it is: the plant does not say what unit its {name} has."
        ]
    if not said:
        return (1.0, 0.0), []
    try:
        found = units.conversion(said, unit)
    except units.UnitError as error:
        raise _refused(column, said, wanted, str(error)) from None
    if found == (1.0, 0.0):
        return found, []
    if abs(wanted.scale) != 1 and math.isclose(abs(wanted.scale), found[0], rel_tol=0.01):
        remedy = "Leave it out" if wanted.scale > 0 else "Give -1"
        raise SelectionError(
            f"{wanted.flag}-scale {wanted.scale:g}: column {column} is converted from {said} to "
            f"{unit} without that. {remedy}."
        )
    return found, [f"Column {column} was converted from {said} to {unit}."]


def _refused(column: str, said: str, wanted: Wanted, reason: str) -> ValueError:
    name, unit = split(wanted.name)
    why = f"the plant's {name} is in {unit}, and {reason}"
    if wanted.unit:
        return SelectionError(f"{wanted.flag}-unit {said}: {why}.")
    remedy = f"{wanted.flag}-unit" if wanted.flag else f"--measured {name}=VALUE"
    return LogError(f"Column {column} says {said!r}, but {why}. Give {remedy}.")
