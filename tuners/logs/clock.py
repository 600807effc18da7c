"""Clocks and dates in cells of text, as seconds."""

import re
from datetime import date

import numpy as np

from tuners.logs.table import Array, LogError

_CLOCK = re.compile(
    r"(?:(?P<day>\d{1,4}[-./]\w{1,9}[-./]\d{1,4}|\d{8})[\sT_,;]*)?"
    r"(?P<hour>\d{1,3}):(?P<minute>\d{1,2})(?::(?P<second>\d{1,2}(?:[.,:]\d+)?)|"
    r"(?P<tenths>[.,]\d+))?"
    r"\s*(?P<half>[ap]\.?m\.?)?\s*(?:z|utc|gmt|[-+]\d\d:?\d\d)?",
    re.IGNORECASE,
)
_MONTHS = "jan feb mar apr may jun jul aug sep oct nov dec".split()
_GERMAN = {"mär": 3, "mrz": 3, "mai": 5, "okt": 10, "dez": 12}
_DAY = 86400.0


def is_clock(text: str) -> bool:
    """Whether a cell is a time of day, with a date or not."""
    return ":" in text and bool(_CLOCK.fullmatch(text))


def seconds(name: str, cells: list[str]) -> Array:
    """Seconds (N,) of cells; ``nan`` where one is empty, and days counted past midnight."""
    values = np.full(len(cells), np.nan)
    days: dict[str, float] = {}
    for k, cell in enumerate(cells):
        found = _CLOCK.fullmatch(cell)
        if found is None:
            if cell and any(map(str.isdigit, cell)):
                raise LogError(f"Column {name} has {cell[:30]!r} in data row {k + 1}: not a time.")
            continue
        day = found["day"] or ""
        if day not in days:
            days[day] = _DAY * _ordinal(day) if day else 0.0
        values[k] = days[day] + _of_day(found)
    return _past_midnight(values)


def _of_day(found: re.Match[str]) -> float:
    hour, minute = int(found["hour"]), int(found["minute"])
    if found["second"] is None:  # minutes and seconds, or hours and minutes
        tenths = float("0" + (found["tenths"] or ".0").replace(",", "."))
        return 60.0 * hour + minute + tenths if found["tenths"] else 3600.0 * hour + 60.0 * minute
    if found["half"]:
        hour = hour % 12 + 12 * (found["half"][0].lower() == "p")
    return 3600.0 * hour + 60.0 * minute + float(re.sub("[,:]", ".", found["second"]))


def _ordinal(text: str) -> int:
    """A date's number; where day and month can be either, the order of days stays right mostly."""
    if text.isdigit():
        text = f"{text[:4]}-{text[4:6]}-{text[6:]}"
    first, middle, last = re.split(r"[-./]", text)
    month = _month(middle)
    try:
        if len(first) == 4:
            return date(int(first), month, int(last)).toordinal()
        year, day = int(last) + 2000 * (len(last) < 4), int(first)
        if "/" in text and day <= 12 or month > 12:  # American
            day, month = month, day
        return date(year, month, day).toordinal()
    except ValueError:
        raise LogError(f"{text!r} is no date that is known.") from None


def _month(text: str) -> int:
    if text.isdigit():
        return int(text)
    short = text[:3].lower()
    return _GERMAN.get(short) or (_MONTHS.index(short) + 1 if short in _MONTHS else 0)


def _past_midnight(values: Array) -> Array:
    known = np.isfinite(values)
    steps = np.diff(values[known], prepend=values[known][:1])
    values[known] += _DAY * np.cumsum(steps < -_DAY / 2)
    return values
