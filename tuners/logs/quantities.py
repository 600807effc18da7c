"""Columns in the plant's units, and what was done to them."""

import math
from dataclasses import dataclass, replace

from tuners.logs import units
from tuners.logs.candidates import Role
from tuners.logs.stamps import epoch_unit
from tuners.logs.table import Array, LogError, SelectionError, Table


@dataclass(frozen=True, slots=True, eq=False)
class Quantity:
    """A column in the plant's unit, and its own time stamps in formats that have some.

    `unit` is what its numbers were taken to be in; empty for the plant's unit and for clock times.
    """

    name: str
    values: Array
    time: Array | None
    unit: str = ""


def quantity_of(
    table: Table, column: str, role: Role, given: str, suffix: str = ""
) -> tuple[Quantity, list[str]]:
    """A column in the role's unit, and what was done to it."""
    read = table.column(column)
    said = given or units.stated(column, read.unit) or suffix
    if read.clock:
        _check_clock(column, role, given)
        return Quantity(column, read.values, read.time), list(read.notes)
    if role.key == "time" and not said:
        said, epoch = epoch_unit(read.values)
        read = replace(read, notes=(*read.notes, *epoch))
    (factor, offset), notes = _conversion(column, said, given, role)
    if role.scale != 1 and notes:
        notes.append(f"Column {column} was then multiplied by {role.scale:g}.")
    values = role.scale * (factor * read.values + offset)
    return Quantity(column, values, read.time, said), [*read.notes, *notes]


def _check_clock(column: str, role: Role, given: str) -> None:
    """Refuse times of day as signals, and a unit of theirs."""
    if role.key != "time":
        raise LogError(f"Column {column} for {role.words} holds times, no numbers.")
    if given:
        raise SelectionError(
            f"--time-unit {given}: column {column} holds clock times. Leave it out."
        )


def _conversion(
    column: str, said: str, given: str, role: Role
) -> tuple[tuple[float, float], list[str]]:
    """Factor and offset to the role's unit, and a note where there are any."""
    if given and not role.unit:
        raise SelectionError(
            f"--{role.key}-unit {given}: the plant does not say what unit its {role.words} has. "
            f"Give --{role.key}-scale."
        )
    if not role.unit:
        note = (
            f"Column {column} was taken as it is: the plant does not say what unit its "
            f"{role.words} has."
        )
        return (1.0, 0.0), [note] if said else []
    if not said:
        return (1.0, 0.0), []
    try:
        found = units.conversion(said, role.unit)
    except units.UnitError as error:
        why = f"the plant's {role.words} is in {role.unit}, and {error}"
        if given:
            what = role.remedy if role.remedy.endswith("unit") else f"unit of {role.words},"
            raise SelectionError(f"{what} {given}: {why}.") from None
        raise LogError(f"Column {column} says {said!r}, but {why}. Give {role.remedy}.") from None
    if found == (1.0, 0.0):
        return found, []
    if abs(role.scale) != 1 and math.isclose(abs(role.scale), found[0], rel_tol=0.01):
        remedy = "Leave it out" if role.scale > 0 else "Give -1"
        raise SelectionError(
            f"--{role.key}-scale {role.scale:g}: column {column} is converted from {said} to "
            f"{role.unit} without that. {remedy}."
        )
    return found, [f"Column {column} was converted from {said} to {role.unit}."]


def converted(value: float, unit: str, role: Role) -> float:
    """A given value in the role's unit."""
    if not unit:
        return value
    (factor, offset), _ = _conversion("", unit, unit, role)
    return factor * value + offset
