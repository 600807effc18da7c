"""Find the columns of a plant's signals, and convert them to its units.

A column is found by a name or a number (from 1) that the user gives, or else by its own name:
the plant's signal, parameter or label, or a synonym of it.  Its unit is the user's, or else the
file's (``speed [rpm]``, ``speed_rpm``, a row of units), or else the plant's, which is in the
name of its signal: ``speed [rad/s]``.  Where that has none, numbers are taken as they are.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from tuners.logs import units
from tuners.logs.options import Options
from tuners.logs.table import Array, LogError, SelectionError, Table
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant

T = TypeVar("T", str, float)

_TIME = "t time timestamp timestamps times sec seconds zeit"


@dataclass(frozen=True, slots=True)
class Role:
    """A quantity for which a column is looked for.

    Attributes
    ----------
    key : str
        ``time``, ``input``, ``output``, or a measured parameter of the plant.
    words, unit : str
        Name in messages, and the unit that is needed; empty if the plant names none.
    names : tuple of str
        Names that columns of it have, the first preferred.
    remedy : str
        What to give where its unit is not understood.
    scale : float
        What the column is multiplied by, once it is in the unit.
    """

    key: str
    words: str
    unit: str
    names: tuple[str, ...]
    remedy: str
    scale: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Quantity:
    """A column in the plant's unit, and its own time stamps in formats that have some."""

    name: str
    values: Array
    time: Array | None


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What a file and the user say of a plant's recording.

    Attributes
    ----------
    quantities : dict
        Columns by role; time and measured parameters may be missing.
    values : dict
        Measured parameters that the user gave.
    notes : tuple of str
        What was converted or assumed, in words.
    """

    quantities: dict[str, Quantity]
    values: dict[str, float]
    notes: tuple[str, ...]


def find(table: Table, plant: Plant, options: Options) -> Found:
    """Find every role's column and convert it to the plant's unit."""
    roles = {role.key: role for role in _roles(plant, options)}
    columns = _by_role(options.columns, roles)
    given_units = _by_role(options.units, roles)
    values = _by_role(options.values, roles)
    _check_given(columns, values, plant)
    if "output" in given_units:
        given_units["reference"] = given_units["output"]
    quantities, notes = {}, []
    for key, role in roles.items():
        if key in values:
            values[key] = _value(values[key], given_units.get(key, ""), role)
            continue
        column = _column(role, columns.get(key), table)
        if column is not None:
            quantities[key], words = _quantity(table, column, role, given_units.get(key, ""))
            notes += words
    if quantities["input"].name == quantities["output"].name:
        raise SelectionError(f"Input and output are both column {quantities['input'].name}.")
    if "reference" in quantities and quantities["reference"].name == quantities["output"].name:
        raise SelectionError(f"Reference and output are both column {quantities['output'].name}.")
    caution = plant.cautions.get(_plain(quantities["input"].name))
    if caution is not None and abs(options.input_scale) == 1:
        notes.append(f"Column {quantities['input'].name} {caution}")
    return Found(quantities, values, tuple(notes))


def _roles(plant: Plant, options: Options) -> Iterator[Role]:
    yield Role("time", "time", "s", tuple(_TIME.split()), "--time-unit")
    scales = options.input_scale, options.output_scale
    for key, signal, short, scale in zip(
        ("input", "output"), plant.signals, "uy", scales, strict=True
    ):
        names = (split(signal)[0], *plant.synonyms.get(key, ()), short)
        yield Role(key, *split(signal), names, f"--{key}-unit", scale)
    unit = split(plant.signals[1])[1]
    yield Role("reference", "the reference", unit, (), "--output-unit", options.output_scale)
    for key in plant.measured:
        words, unit = split(plant.label(key))
        names = (split(key)[0], words, *plant.synonyms.get(key, ()))
        said = words if words.isidentifier() else key
        yield Role(key, words, unit, names, f"--measured {said}=VALUE")


def _by_role(given: Mapping[str, T], roles: dict[str, Role]) -> dict[str, T]:
    """What was given by role, which a parameter's name or label stands for."""
    found: dict[str, T] = {}
    for name, value in given.items():
        key = next((k for k, r in roles.items() if _plain(name) in map(_plain, (k, r.words))), None)
        if key is None:
            measured = list(roles)[4:]
            raise SelectionError(
                f"measured {name!r} is unknown. Choose one of {', '.join(measured)}."
                if measured
                else f"measured {name!r}: this plant has no measured parameters."
            )
        if key in found:
            raise SelectionError(f"{name} is given twice.")
        found[key] = value
    return found


def _check_given(columns: dict[str, str], values: dict[str, float], plant: Plant) -> None:
    for key in values:
        if key not in plant.measured:
            raise SelectionError(f"values {key!r} must be a column. Give columns[{key!r}].")
        if key in columns:
            raise SelectionError(f"{key} is given twice, as a value and as a column.")


def _column(role: Role, given: str | None, table: Table) -> str | None:
    """The column that the user chose, or that has one of the role's names."""
    if given is not None:
        return named(given, role.words, table.names)
    column = recognised(role, table.names)
    if column is None and role.key in ("input", "output"):
        raise LogError(
            f"No column looks like {role.words}; there are {listed(table.names)}. "
            f"Name one with --{role.key}-column."
        )
    return column


def recognised(role: Role, columns: Sequence[str]) -> str | None:
    """The first column of the role's first name that has one, with a unit or not."""
    for name in map(_plain, role.names):
        for column in columns:
            if _plain(column) == name:
                return column
        for column in columns:
            if _suffix(column, name, role.unit):
                return column
    return None


def named(given: str, words: str, columns: Sequence[str]) -> str:
    """The column that the user means by a name, with its unit or not, or a number from 1."""
    if given in columns:
        return given
    whole = [column for column in columns if _bare(column) == given]
    if len(whole) == 1:
        return whole[0]
    if given.isdecimal() and 1 <= int(given) <= len(columns):
        return columns[int(given) - 1]
    raise SelectionError(f"No column {given!r} for {words}; there are {listed(columns)}.")


def listed(names: Sequence[str], most: int = 12) -> str:
    """Names in one line, not too many."""
    first = ", ".join(names[:most])
    return f"{first} and {len(names) - most} more" if len(names) > most else first


def _bare(column: str) -> str:
    """A column's name without its unit in brackets."""
    return re.sub(r"\[.*?\]|\(.*\)", "", column).strip()


def _last(column: str) -> str:
    """The same without the structure that it is a field of: ``log.speed [m/s]`` is ``speed``."""
    return _bare(column).rpartition(".")[2] or _bare(column)


def _plain(column: str) -> str:
    """The same in lower case, letters and digits alone."""
    return re.sub(r"[\W_]", "", _last(column).lower())


def _suffix(column: str, name: str, unit: str) -> str:
    """The unit in ``speed_rpm`` for ``speed`` in a unit; a symbol's may be an index."""
    parts = _last(column).split("_")
    for k in range(1, len(parts)):
        said = "_".join(parts[k:])
        known = said == unit or (len(name) > 1 or len(said) > 1) and unit
        if _plain("_".join(parts[:k])) == name and known and units.alike(said, unit):
            return said
    return ""


def _quantity(table: Table, column: str, role: Role, given: str) -> tuple[Quantity, list[str]]:
    """A column in the role's unit, and what was done to it."""
    read = table.column(column)
    said = given or units.stated(column, read.unit)
    if not said and role.unit and _plain(column) not in map(_plain, role.names):
        said = next((s for n in role.names if (s := _suffix(column, _plain(n), role.unit))), "")
    (factor, offset), notes = _conversion(column, said, given, role)
    if role.scale != 1 and notes:
        notes.append(f"Column {column} was then multiplied by {role.scale:g}.")
    return Quantity(column, role.scale * (factor * read.values + offset), read.time), notes


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


def _value(value: float, unit: str, role: Role) -> float:
    """A given value in the role's unit."""
    if not unit:
        return value
    (factor, offset), _ = _conversion("", unit, unit, role)
    return factor * value + offset
