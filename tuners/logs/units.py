"""Any physical unit to any other of its kind, by Pint and the spellings that logs have.

Pint counts angles as numbers, so that 1 Hz would be 1 rad/s; here units are of one kind where
their base units are the same, and the radian is one of these.
"""

import math
import re
from functools import cache
from typing import Any

import numpy as np

_SPELLINGS = (
    "newton_meter = newton * meter = Nm",  # instead of a measure of yarn
    "degree_per_second = degree / second = dps = degs = degps",
    "radian_per_second = radian / second = rads = radps",
    "meter_per_second = meter / second = mps = meterspersecond",
    "@alias kilometer_per_hour = kmh",
    "@alias degree = grad = Grad",  # instead of the gradian
    "@alias revolution = rev = r = U",
    "@alias ohm = Ohm",
)
_IDIOMS = {"-": "1", "ms-1": "m/s"}
_TERM = r"(?:[^\W\d_]+|°[CF]?|%|1)(?:\^?-?[\d²³])?"
_FORM = re.compile(rf"\(?{_TERM}(?:(?:\s*[*/·._]\s*\(?|\s+){_TERM}\)?)*")
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


def conversion(unit: str, needed: str) -> tuple[float, float]:
    """Factor and offset that bring numbers in a unit to the needed one.

    Raises
    ------
    UnitError
        There are none.
    """
    if unit == needed:
        return 1.0, 0.0
    targets, sources = _meanings(needed), _meanings(unit)
    pairs = ((s, t) for t in targets for s in sources if _kind(s) == _kind(t))
    source, target = next(pairs, (None, None))
    if source is None:
        raise UnitError(f"{unit} and {needed} measure different things")
    numbers = _registry().Quantity(np.arange(3.0), source)
    zero, one, two = numbers.to(target).magnitude.tolist()
    if not math.isclose(one - zero, two - one, rel_tol=1e-6):
        raise UnitError(f"{unit} to {needed} is no matter of factors")
    return one - zero, zero


def alike(unit: str, needed: str) -> bool:
    """Whether there is a conversion."""
    try:
        conversion(unit, needed)
    except UnitError:
        return False
    return True


def known(text: str) -> bool:
    """Whether a text is a unit, in brackets or not."""
    text = re.sub(r"^[\[(]|[\])]$", "", text.strip())
    try:
        return bool(_meanings(text))
    except UnitError:
        return False


def _meanings(text: str) -> list[Any]:
    """Units that a text may mean: as it is, or in lower case where capitals have no reason."""
    spellings = dict.fromkeys([text, text.lower() if len(text) > 2 else text])
    found = [unit for unit in map(_parsed, spellings) if unit is not None]
    if not found:
        raise UnitError(f"{text!r} is no unit that is known")
    return found


def _kind(unit: Any) -> Any:
    return _registry().Quantity(1.0, unit).to_root_units().units


@cache
def _parsed(text: str) -> Any:
    """The unit, or None; what does not look like one must not reach Pint's parser."""
    registry, text = _registry(), _IDIOMS.get(text, text)
    if len(text) > _LONGEST or not _FORM.fullmatch(text):
        return None
    powers = re.sub(r"([^\W\d_])\^?(-?\d)", r"\1**\2", re.sub(r"[·.]", "*", text))
    try:
        return registry.parse_units(powers.replace("_", "/"))
    except Exception:  # Pint raises all kinds on texts that are no units
        return None


@cache
def _registry() -> Any:
    try:
        from pint import UnitRegistry
    except ImportError:
        raise UnitError('units are converted by Pint: pip install "yawrate[tune]"') from None
    registry: Any = UnitRegistry(on_redefinition="ignore")
    for spelling in _SPELLINGS:
        registry.define(spelling)
    return registry
