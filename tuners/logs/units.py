"""Any physical unit to any other of its kind, by Pint.

What a log writes is looked up first among the spellings of `columns` and a few others:
Pint takes ``Nm`` for a measure of yarn and ``grad`` for a gradian, and does not know ``dps``.
It also counts angles as numbers, so that 1 Hz would be 1 rad/s; here units are of one kind
where their base units are the same, and the radian is one of these.
"""

import math
import re
from functools import cache
from typing import Any

import numpy as np

from tuners.logs.columns import SPELLINGS

_MEANT = {word: unit for unit, words in SPELLINGS.items() for word in words.split()} | {
    "U/min": "rpm",
    "r/min": "rpm",
    "-": "1",
}
_TERMS = {"Nm": "(N*m)", "mNm": "(mN*m)", "kNm": "(kN*m)", "Ohm": "ohm", "kOhm": "kohm",
          "rev": "revolution", "·": "*"}  # fmt: skip
_TERM = r"(?:[^\W\d_]+|°[CF]?|%|1)(?:\^?-?\d)?"
_FORM = re.compile(rf"\(?{_TERM}(?:(?:\s*[*/·.]\s*\(?|\s+){_TERM}\)?)*")
_LONGEST = 30


class UnitError(ValueError):
    """A unit that is not known, or is of another kind; the message names it, as a clause."""


def stated(name: str, unit: str) -> str:
    """What a column's unit is, by its file or else by the brackets in its name; or nothing."""
    if unit:
        within = re.fullmatch(r"\[(.*)\]|\((.*)\)", unit.strip())
    else:
        within = re.search(r"\[(.*?)\]", name) or re.search(r"\((.*)\)", name)
    said = (within[within.lastindex or 0] if within else unit).strip()
    return said if said == "1" or re.search(r"[^\W\d_]|[°%]", said) else ""


def conversion(unit: str, wanted: str) -> tuple[float, float]:
    """Factor and offset that bring numbers in a unit to the wanted one.

    Raises
    ------
    UnitError
        There are none.
    """
    if unit == wanted:
        return 1.0, 0.0
    source, target = (_known(text) for text in (unit, wanted))
    if source.to_root_units().units != target.to_root_units().units:
        raise UnitError(f"{unit} and {wanted} measure different things")
    numbers = _registry().Quantity(np.arange(3.0), source.units)
    zero, one, two = numbers.to(target.units).magnitude.tolist()
    if not math.isclose(one - zero, two - one, rel_tol=1e-6):
        raise UnitError(f"{unit} to {wanted} is no matter of factors")
    return one - zero, zero


def alike(unit: str, wanted: str) -> bool:
    """Whether there is a conversion."""
    try:
        conversion(unit, wanted)
    except UnitError:
        return False
    return True


def _known(text: str) -> Any:
    """One of the unit; what is in capitals for no reason is understood too."""
    small = text.lower() if len(text) > 2 else text
    meant = _MEANT.get(text) or _MEANT.get(small)
    spellings = [text, small] if meant is None else [meant]
    found = next((q for q in map(_parsed, spellings) if q is not None), None)
    if found is None:
        raise UnitError(f"{text!r} is no unit that is known")
    return found


@cache
def _parsed(text: str) -> Any:
    """One of the unit, or None; what does not look like one must not reach Pint's parser."""
    if len(text) > _LONGEST or not _FORM.fullmatch(text):
        return None
    registry = _registry()
    terms = re.sub(r"[^\W\d_]+|·", lambda term: _TERMS.get(term[0], term[0]), text)
    powers = re.sub(r"([^\W\d_])\^?(-?\d)", r"\1**\2", terms)
    try:
        return registry.Quantity(1.0, registry.parse_units(powers))
    except Exception:  # Pint raises all kinds on texts that are no units
        return None


@cache
def _registry() -> Any:
    try:
        from pint import UnitRegistry
    except ImportError:
        raise UnitError('units are converted by Pint: pip install "yawrate[tune]"') from None
    return UnitRegistry()
