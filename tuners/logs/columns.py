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

import numpy as np

from tuners.logs import names
from tuners.logs.candidates import Candidate, Role, candidates, last, repeats
from tuners.logs.options import Options
from tuners.logs.quantities import Quantity, converted, quantity_of
from tuners.logs.table import Array, LogError, SelectionError, Table
from tuners.tuner.recording import STEADY
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant

T = TypeVar("T", str, float)


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
    for key in ("input", "output"):
        if key in given_units:  # that of all inputs, or all outputs
            given_units |= dict.fromkeys(channels(plant, key), given_units[key])
    values = _by_role(options.values, roles)
    _check_given(columns, values, plant)
    if "output" in given_units and "reference" in columns:
        given_units["reference"] = given_units["output"]
    quantities, notes = {}, []
    for key, role in roles.items():
        if key in values:
            values[key] = converted(values[key], given_units.get(key, ""), role)
            continue
        column, others = _column(role, columns.get(key), table)
        if column is not None:
            suffix = next((c.match.suffix for c in candidates(role, [column])), "")
            unit = given_units.get(key, "")
            quantities[key], words = quantity_of(table, column, role, unit, suffix)
            notes += [*words, *others]
    for key, unit in given_units.items():
        if key not in quantities and key not in values and options.Ts is None:
            raise SelectionError(
                f"--{roles[key].words}-unit {unit}: the log has no column of {roles[key].words}."
            )
    if quantities["input"].name == quantities["output"].name:
        raise SelectionError(f"Input and output are both column {quantities['input'].name}.")
    if plant.channels is not None:
        _check_apart(quantities, roles)
    if "reference" in quantities and quantities["reference"].name == quantities["output"].name:
        raise SelectionError(f"Reference and output are both column {quantities['output'].name}.")
    caution = _caution(roles["input"], quantities["input"].name, plant)
    if caution and abs(options.input_scale) == 1:
        notes.append(f"Column {quantities['input'].name} {caution}")
    return Found(quantities, values, tuple(notes))


def _check_apart(quantities: Mapping[str, Quantity], roles: Mapping[str, Role]) -> None:
    """Each of several channels has a column of its own."""
    seen: dict[str, str] = {}
    for key, quantity in quantities.items():
        words = roles[key].words
        if quantity.name in seen:
            raise SelectionError(
                f"{seen[quantity.name]} and {words} are both column {quantity.name}."
            )
        seen[quantity.name] = words


def channel(key: str, index: int) -> str:
    """Role of an input or output: ``input`` of the first, ``input 2`` of the second."""
    return key if index == 0 else f"{key} {index + 1}"


def channels(plant: Plant, key: str) -> list[str]:
    """Roles of all inputs, or outputs."""
    named = plant.inputs_named if key == "input" else plant.outputs_named
    return [channel(key, i) for i in range(len(named))]


def _caution(role: Role, column: str, plant: Plant) -> str:
    """What the plant says of a column of such a name."""
    if not any(c.match.kind == names.WARNED for c in candidates(role, [column])):
        return ""
    said = set(names.words(names.bare(column)))
    return next((text for name, text in plant.cautions.items() if {*names.words(name)} <= said), "")


def _roles(plant: Plant, options: Options) -> Iterator[Role]:
    yield Role("time", "time", "s", ("time", "t"), "--time-unit", "--time-column", own=2)
    warned = tuple(" ".join(names.words(name)) for name in plant.cautions)
    scales = options.input_scale, options.output_scale
    several = plant.channels is not None
    for key, signals, short, scale in zip(
        ("input", "output"), (plant.inputs_named, plant.outputs_named), "uy", scales, strict=True
    ):
        for i, signal in enumerate(signals):
            words, unit = split(signal)
            called = words, *plant.synonyms.get(key, ()), f"{short}{i + 1}" if several else short
            flag = f"--column {_quoted(words)}=COLUMN" if several else f"--{key}-column"
            yield Role(
                channel(key, i), words, unit, called, f"--{key}-unit", flag, scale, 1, warned, True
            )
    unit, scale = split(plant.signals[1])[1], options.output_scale
    yield Role("reference", "the reference", unit, (), "--output-unit", "--reference", scale)
    for key in plant.measured:
        words, unit = split(plant.label(key))
        called = (words, split(key)[0], *plant.synonyms.get(key, ()))
        said = words if words.isidentifier() else key
        value, column = (f"--measured {said}={what}" for what in ("VALUE", "COLUMN"))
        yield Role(key, words, unit, called, value, column, own=2)


def _by_role(given: Mapping[str, T], roles: dict[str, Role]) -> dict[str, T]:
    """What was given by role, which a parameter's name or label stands for."""
    found: dict[str, T] = {}
    for name, value in given.items():
        key = next((k for k, r in roles.items() if _plain(name) in map(_plain, (k, r.words))), None)
        if key is None:
            measured = list(roles)[list(roles).index("reference") + 1 :]
            known = [r.words for r in roles.values() if r.flag.startswith("--column")] + measured
            raise SelectionError(
                f"{name!r} is unknown. Choose one of {', '.join(known)}."
                if known
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


def _column(role: Role, given: str | None, table: Table) -> tuple[str | None, list[str]]:
    """The column that the user chose, or that has one of the role's names; and notes."""
    if given is not None:
        return named(given, role.words, table.names), []
    ranked = candidates(role, table.names)
    if not ranked:
        if role.needed:
            raise LogError(
                f"No column looks like {role.words}; there are {listed(table.names)}. "
                f"Name one with {role.flag}."
            )
        return None, []
    first = ranked[0]
    equal = [c for c in ranked if c.match == first.match or repeats(c.name, first.name)]
    equal = _different(equal, table) if len(equal) > 1 and role.key != "time" else equal[:1]
    if len(equal) > 1:
        raise LogError(
            f"Columns {listed([c.name for c in equal])} all look like {role.words}. "
            f"Name one with {role.flag}."
        )
    others = [c for c in ranked if c.match.kind <= names.UNSURE and c.name != first.name]
    unsure = [f"Column {first.name} was taken as {role.words}."]
    unsure *= first.match.kind == names.UNSURE
    if role.key == "time" or not others:
        return first.name, unsure
    return first.name, unsure + _second(role, first, _different([first, *others], table)[1:], table)


def _different(equal: list[Candidate], table: Table) -> list[Candidate]:
    """Candidates whose values are not those of an earlier one; columns without any are left out."""
    kept: list[tuple[Candidate, Array]] = []
    for candidate in equal:
        try:
            values = table.column(candidate.name).values
        except LogError:
            continue
        if np.isfinite(values).any() and not any(_same(values, others) for _, others in kept):
            kept.append((candidate, values))
    return [candidate for candidate, _ in kept] or equal[:1]


def _same(a: Array, b: Array) -> bool:
    if a.shape != b.shape:
        return False
    both = np.isfinite(a) & np.isfinite(b)
    return bool(both.any()) and bool(np.allclose(a[both], b[both], rtol=1e-3))


def _second(role: Role, first: Candidate, others: list[Candidate], table: Table) -> list[str]:
    """A note on columns that were passed over."""
    if not others:
        return []
    if role.needed:
        also = listed([c.name for c in others])
        return [f"Column {first.name} was taken as {role.words}; {also} may be meant too."]
    means = {c.name: _mean(c, role, table) for c in (first, *others)}
    chosen = means.pop(first.name)
    apart = {n: m for n, m in means.items() if not abs(m - chosen) <= STEADY * abs(chosen)}
    said = ", ".join(f"{name} {mean:.3g}" for name, mean in apart.items())
    return (
        [
            f"Columns contradict each other on {role.words}: {first.name} {chosen:.3g}, which is "
            f"used, and {said}."
        ]
        if apart
        else []
    )


def _mean(candidate: Candidate, role: Role, table: Table) -> float:
    found, _ = quantity_of(table, candidate.name, role, "", candidate.match.suffix)
    known = found.values[np.isfinite(found.values)]
    return float(known.mean()) if len(known) else math.nan


def _quoted(name: str) -> str:
    """A name as a shell takes it."""
    return name if name.isidentifier() else repr(name)


def named(given: str, words: str, columns: Sequence[str]) -> str:
    """The column that the user means by a name, with its unit or not, or a number from 1."""
    if given in columns:
        return given
    whole = [column for column in columns if names.bare(column) == given]
    if len(whole) == 1:
        return whole[0]
    if given.isdecimal() and 1 <= int(given) <= len(columns):
        return columns[int(given) - 1]
    raise SelectionError(f"No column {given!r} for {words}; there are {listed(columns)}.")


def listed(columns: Sequence[str], most: int = 12) -> str:
    """Names in one line, not too many."""
    first = ", ".join(columns[:most])
    return f"{first} and {len(columns) - most} more" if len(columns) > most else first


def _plain(column: str) -> str:
    """The same in lower case, letters and digits alone."""
    return re.sub(r"[\W_]", "", last(column).lower())
