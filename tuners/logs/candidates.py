"""Columns that a role may mean, by their names and the kind of unit that they state."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from tuners.logs import names, units


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
    flag : str
        Option that names its column.
    scale : float
        What the column is multiplied by, once it is in the unit.
    own : int
        How many of the names are the plant's own; others are synonyms.
    warned : tuple of str
        Synonyms that the plant warns of.
    needed : bool
        Whether a recording cannot be used without it.
    """

    key: str
    words: str
    unit: str
    names: tuple[str, ...]
    remedy: str
    flag: str
    scale: float = 1.0
    own: int = 1
    warned: tuple[str, ...] = ()
    needed: bool = False


@dataclass(frozen=True, slots=True)
class Candidate:
    """A column that a role may mean, and the name that it has without a unit at its end."""

    name: str
    match: names.Match


def candidates(role: Role, columns: Sequence[str]) -> list[Candidate]:
    """Columns that have one of a role's names, the likeliest first; no other kind of unit."""
    phrases = tuple(dict.fromkeys(map(names.words, role.names)))
    found = []
    for column in columns:
        match = names.match(last(column), phrases, role.own, role.warned)
        whole = names.match(column, phrases, role.own, role.warned)
        match = min((m for m in (match, whole) if m is not None), default=None)
        if match is None or match.kind == names.UNSURE:
            with_unit = _with_suffix(column, role, phrases)
            match = with_unit or match
        if match is not None and not (match.kind == names.VAGUE and _foreign(column, role)):
            found.append(Candidate(column, match))
    return sorted(found, key=lambda c: (c.match.kind, c.match.order, c.match.extra))


def _with_suffix(
    column: str, role: Role, phrases: tuple[tuple[str, ...], ...]
) -> names.Match | None:
    """The same for a name that ends in a unit of the role's kind: ``yawRateDps``, ``v_km_h``."""
    name = names.bare(column)
    starts = [found.start() for found in re.finditer(r"(?<=[_\W])\w|(?<=[a-z0-9])[A-Z]", name)]
    fits = []
    for start in starts[:-4:-1]:
        match = names.match(name[:start], phrases, role.own, role.warned)
        said = name[start:]
        symbol = len(re.sub(r"[\W_]", "", name[:start])) == 1 and len(said) == 1
        if match is None or not role.unit:
            continue
        if said == role.unit or (not symbol and units.alike(said, role.unit)):
            fits.append(replace(match, suffix=said))
    return min(fits, default=None)  # of ``voltage_mV`` the unit is mV: ``voltage_m`` is no name


def _foreign(column: str, role: Role) -> bool:
    """Whether a column states a unit that measures something else: ``y(m)`` is no yaw rate."""
    said = units.stated(column, "")
    return bool(said and role.unit) and units.known(said) and not units.alike(said, role.unit)


def repeats(name: str, first: str) -> bool:
    """Whether a name is another's with the number that sets repeated names apart."""
    return bool(re.fullmatch(re.escape(first) + r"_\d+", name))


def last(column: str) -> str:
    """The same without the structure that it is a field of: ``log.speed [m/s]`` is ``speed``."""
    return names.bare(column).rpartition(".")[2] or names.bare(column)
