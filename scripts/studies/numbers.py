"""Numbers in pages for people: each has a source, and is compared with it.

A number stands in a block that a program writes (`studies.readme`), or is followed by an anchor, a
comment that says where it comes from:

    98 %<!-- robustness.json: rows/0/usable * 100 -->
    3°<!-- code: studies.trusting:MISS/0 -->
    500 times<!-- nonlinear.json: rows/0/rms / rows/1/rms -->

`studies.sources` has the grammar.  The number must be the source's, rounded to as many digits as it
is printed with.

Some numbers are no claims: code, formulas, the numerals of lists, names (2DOF), indices of rows,
and references to equations, figures and years.  Each is recognised by a pattern of its own, which
is narrow: code that is nothing but a number, or a formula with more than one-digit integers,
needs a source, too.
"""

import re
from collections.abc import Iterator
from pathlib import Path

from studies.sources import value_of

NUMBER = (
    r"(?<![\w^])(?<!\d[.,])"  # not within a name such as x2
    r"(?:\d{1,3}(?:[ ,\u00a0\u202f]\d{3})+(?!\d)|\d+)(?:\.\d+)?(?:e[-+]?\d+)?"
)

_SOURCE = r"(?:[\d.]+ [*/] )?(?:code|[\w./-]+\.json): .+?"
_ANCHOR = re.compile(rf"((?:(?<!\w)[-−])?{NUMBER})([^\d<]{{0,12}})<!-- ({_SOURCE}) -->")
_GENERATED = re.compile(r"<!-- ([\w-]+):start -->.*?<!-- \1:end -->", re.DOTALL)
_FENCE = re.compile(r"^( *)(```+|~~~+).*?^\1\2$", re.DOTALL | re.MULTILINE)
_SPAN = re.compile(r"`([^`]*)`")
_FORMULA = re.compile(r"\$([^$\n]+)\$")
_TARGET = re.compile(r"\]\([^)]*\)")
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)

_QUANTITY = rf"[-−±~≈]?{NUMBER}\s*(?:%|°|[A-Za-z]{{1,3}}(?:/s)?)?"
_BARE = re.compile(rf"{_QUANTITY}(?:(?:, | to | and |/){_QUANTITY})*")
"""Code that is nothing but numbers, with units or without."""

_ITEM = re.compile(r"^(?:#+ | *)(\d+)\. (?=\S)")
_INDICES = re.compile(r"^\| (\d(?:, \d)*) \|")

REFERENCES = (
    r"\beqs?\. \(\d{1,2}\)(?:, \(\d{1,2}\))*",
    r"\b[Ff]igures? \d(?: to \d)?\b(?!\.\d)",
    r"\bstep \d\b(?! [%°]|\.\d)",
    r"\b[A-Z][^\W\dA-Z_]+(?:,| et al\.) (?:19[5-9]|20[0-2])\d(?=[);])",  # (Skogestad, 2003)
    r"\b2DOF\b",
    r"\bPython 3\.\d\d(?: to 3\.\d\d)?\b",
    r"\bROS 2\b",
    r"\bMDF 3\s+and 4\b",
    r"\[[-−]1, 1\]|\[0, 1\]",  # the unit boxes
)
"""What is a reference or a name and no claim."""

_REFERENCE = re.compile("|".join(REFERENCES))


def wrong(page: str, root: Path) -> list[str]:
    """Anchored numbers that are not their sources', and what these are."""
    return [
        f"{printed} is {value:.6g}: {source}"
        for printed, _, source in _ANCHOR.findall(page)
        for value in [value_of(source, root)]
        if not _agrees(printed, value)
    ]


def unanchored(page: str) -> list[str]:
    """Numbers without a source."""
    text = _GENERATED.sub("", page)
    text = "\n".join(_without_numerals(_FENCE.sub("", text).splitlines()))
    text = _COMMENT.sub(" ", _ANCHOR.sub(" ", text))
    text = _SPAN.sub(lambda found: found[1] if _BARE.fullmatch(found[1].strip()) else " ", text)
    text = _TARGET.sub("] ", text)
    text = _FORMULA.sub(lambda found: re.sub(r"(?<![\d.,])\d(?![\d.,])", " ", found[1]), text)
    return re.findall(NUMBER, _REFERENCE.sub(" ", text))


def _without_numerals(lines: list[str]) -> Iterator[str]:
    """Lines without the numerals of lists and headings and the indices of a table's rows.

    Numerals begin at 1 and indices at 0, and none is left out.
    """
    last, index = dict.fromkeys((True, False), 0), -1
    for line in lines:
        if row := _INDICES.match(line):
            found = [int(n) for n in row[1].split(", ")]
            if found == list(range(found[0], found[-1] + 1)) and found[0] in (0, index + 1):
                index = found[-1]
                line = line[row.end() :]
        item, heading = _ITEM.match(line), line.startswith("#")
        if item and int(item[1]) in (1, last[heading] + 1):
            last[heading] = int(item[1])
            line = line[item.end() :]
        yield line


def _agrees(printed: str, value: float) -> bool:
    digits = re.sub(r"[, \u00a0\u202f]", "", printed).replace("−", "-")
    decimals = len(digits.partition(".")[2])
    if "e" not in digits and f"{value:.{decimals}f}" == digits:
        return True
    return float(f"{value:.{_significant(digits)}g}") == float(digits)


def _significant(digits: str) -> int:
    """Number of digits that count in a printed number; zeros that end a whole one may not."""
    mantissa = digits.partition("e")[0]
    whole = "." not in mantissa
    kept = mantissa.replace(".", "").lstrip("-0")
    return max(len(kept.rstrip("0") if whole else kept), 1)
