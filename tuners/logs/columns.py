"""Which column is which, and in which unit.

A column is found by a name or a number (from 1) that the user gives, or else by its own
name: `t`, `steer`, `yaw_rate`, `speed` and what else these are called.  A unit is the
user's, or else the file's (``steer [deg]``, ``steer_deg``, a row of units), or else SI.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tuners.logs.table import Array, Column, LogError, SelectionError, Table

ROLES = ("time", "steer", "yaw_rate", "speed")
SYNONYMS = {
    "time": "t time timestamp timestamps times sec seconds zeit",
    "steer": "steer steering steercmd steeringcmd steercommand steeringcommand command cmd u delta "
    "deltaf deltacmd deltafcmd steerangle steeringangle roadwheelangle rwa handwheelangle "
    "steeringwheelangle swa lenkwinkel",
    "yaw_rate": "yawrate yaw r y yawvelocity yawspeed gyroz wz omegaz psidot gierrate "
    "yawratemeas measuredyawrate",
    "speed": "speed v vx velocity vehiclespeed carspeed egospeed geschwindigkeit",
}
HAND_WHEEL = ("handwheelangle", "steeringwheelangle", "swa", "lenkwinkel")
UNITS = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "steer": {"rad": 1.0, "deg": np.pi / 180},
    "yaw_rate": {"rad/s": 1.0, "deg/s": np.pi / 180},
    "speed": {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704},
}
SPELLINGS = {
    "s": "s sec seconds", "ms": "ms", "us": "us µs", "ns": "ns",
    "min": "min minutes", "h": "h hours",
    "rad": "rad radians", "deg": "deg ° degrees degree grad",
    "rad/s": "rad/s rads radps rad_s rad/sec", "deg/s": "deg/s degs degps deg_s °/s deg/sec dps",
    "m/s": "m/s mps m_s ms-1 meterspersecond", "km/h": "km/h kmh kph km_h", "mph": "mph mi/h",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Choice:
    """What the user says about the columns; what is not said is found out.

    Attributes
    ----------
    columns : dict
        Name or number (from 1) of a column, by role.
    units : dict
        Unit, by role.
    """

    columns: dict[str, str] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Quantity:
    """A column in SI units, and what was found out about it."""

    name: str
    unit: str
    values: Array
    time: Array | None


def find(table: Table, choice: Choice) -> dict[str, Quantity]:
    """Quantities by role, in SI units; time and speed may be missing."""
    found = {}
    for role in ROLES:
        quantity = of_role(role, table, choice)
        if quantity is not None:
            found[role] = quantity
    for role in ("steer", "yaw_rate"):
        if role not in found:
            flag = "--" + role.replace("_", "-") + "-column"
            raise LogError(
                f"No column looks like {role}; there are {listed(table.names)}. "
                f"Name one with {flag}."
            )
    if found["steer"].name == found["yaw_rate"].name:
        raise SelectionError(f"Steering and yaw rate are both column {found['steer'].name}.")
    return found


def of_role(role: str, table: Table, choice: Choice) -> Quantity | None:
    """The column that was chosen for this, or that looks like it."""
    given = choice.columns.get(role)
    name = recognised(role, table.names) if given is None else named(given, role, table.names)
    if name is None:
        return None
    return _quantity(role, name, table.column(name), choice.units.get(role))


def recognised(role: str, names: Sequence[str]) -> str | None:
    """The column whose name says that it is this; the earliest synonym wins."""
    plain: dict[str, str] = {}
    for name in names:
        plain.setdefault(_plain(_split(name, role)[0]), name)
    return next((plain[s] for s in SYNONYMS[role].split() if s in plain), None)


def is_hand_wheel(name: str) -> bool:
    """Whether a column's name says that it is measured at the hand wheel."""
    return _plain(_split(name, "steer")[0]) in HAND_WHEEL


def _quantity(role: str, name: str, column: Column, unit: str | None) -> Quantity:
    unit = unit or _unit_of(role, name, column.unit)
    return Quantity(name, unit, column.values * UNITS[role][unit], column.time)


def named(given: str, role: str, names: Sequence[str]) -> str:
    """The column that the user means by a name, with its unit or not, or a number from 1."""
    if given in names:
        return given
    whole = [name for name in names if re.sub(r"[\[(].*?[\])]", "", name).strip() == given]
    if len(whole) == 1:
        return whole[0]
    if given.isdecimal() and 1 <= int(given) <= len(names):
        return names[int(given) - 1]
    raise SelectionError(f"No column {given!r} for {role}; there are {listed(names)}.")


def _split(name: str, role: str) -> tuple[str, str]:
    """A column's name without structure and unit, and what stands for the unit."""
    last = name.rpartition(".")[2] or name
    bracketed = re.search(r"[\[(](.*?)[\])]", last)
    if bracketed:
        return last.replace(bracketed.group(), "").strip(), bracketed.group(1)
    for unit in UNITS[role]:
        for spelling in SPELLINGS[unit].split():
            if last.lower().endswith(f"_{spelling}"):
                return last[: -len(spelling) - 1], spelling
    return last, ""


def _unit_of(role: str, name: str, stated: str) -> str:
    """What the file says, or SI if it says nothing; what is not understood is refused."""
    said = stated or _split(name, role)[1]
    wanted = said.strip(" []()").lower()
    if not re.search(r"[^\W\d_]|[°%]", wanted):
        return next(iter(UNITS[role]))
    for unit in UNITS[role]:
        if wanted in SPELLINGS[unit].split():
            return unit
    flag = role.replace("_", "-")
    raise LogError(
        f"Column {name} says {said.strip()!r} where its unit is expected, which is none of "
        f"{', '.join(UNITS[role])}. Give --{flag}-unit."
    )


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def listed(names: Sequence[str], most: int = 12) -> str:
    """Names in one line, not too many."""
    shown = ", ".join(names[:most])
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown
