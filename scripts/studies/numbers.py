"""Numbers in pages for people: each follows from a stored result, and says from which.

A measured number stands in a block that a program writes (`studies.readme`), or is followed by an
anchor, a comment that names a file in results/ and where in it the number stands:

    98 %<!-- robustness.json: rows/0/usable * 100 -->

Steps of the path are keys, indices, and ``name=value`` to choose from a list; what follows is a
factor.  The number must be the stored one, rounded to as many digits as it is printed with.
"""

import json
import re
from pathlib import Path
from typing import Any

NUMBER = r"(?<![\w.,/^_-])\d(?:[\d,.  ]*\d)?"

_ANCHOR = re.compile(rf"({NUMBER})([^\d<]{{0,12}})<!-- ([\w-]+\.json): (.+?)(?: \* ([\d.]+))? -->")
_GENERATED = re.compile(r"<!-- ([\w-]+):start -->.*?<!-- \1:end -->", re.DOTALL)
_CODE = re.compile(r"```.*?```|`[^`]*`", re.DOTALL)
_TARGET = re.compile(r"\]\([^)]*\)")
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)


def wrong(page: str, results: Path) -> list[str]:
    """Anchored numbers that are not the stored ones, and what these are."""
    return [
        f"{printed} is {value:.6g}: {file}: {path}"
        for printed, _, file, path, factor in _ANCHOR.findall(page)
        for value in [_stored(results / file, path) * float(factor or 1)]
        if not _agrees(printed, value)
    ]


def unanchored(page: str) -> list[str]:
    """Numbers outside of generated blocks, code, links and anchors."""
    text = _ANCHOR.sub("", _GENERATED.sub("", page))
    for pattern in (_CODE, _TARGET, _COMMENT):
        text = pattern.sub(" ", text)
    return re.findall(NUMBER, text)


def _agrees(printed: str, value: float) -> bool:
    digits = re.sub(r"[,  ]", "", printed)
    decimals = len(digits.partition(".")[2])
    return f"{value:.{decimals}f}" == digits or float(f"{value:.{_significant(digits)}g}") == float(
        digits
    )


def _significant(digits: str) -> int:
    """How many a number without a decimal point is printed with; zeros at its end may be none."""
    return max(len(digits.replace(".", "").strip("0")), 1)


def _stored(file: Path, path: str) -> float:
    value: Any = json.loads(file.read_text())
    for step in path.split("/"):
        if isinstance(value, list):
            value = value[int(step)] if step.isdecimal() else _chosen(value, step)
        else:
            value = value[step]
    return float(value)


def _chosen(rows: list[dict[str, Any]], step: str) -> dict[str, Any]:
    """The one row with these values, as in ``tuner=gb&episodes=1500``."""
    wanted = dict(pair.split("=", 1) for pair in step.split("&"))
    (row,) = (r for r in rows if all(f"{r.get(k)}" == v for k, v in wanted.items()))
    return row
