"""Cells of text as numbers: decimal commas, thousands separators, clocks and dates."""

import re
from typing import Any

import numpy as np

from tuners.logs.clock import is_clock, seconds
from tuners.logs.table import Array, Column, LogError

_MISSING = frozenset(
    "- -- --- ? * n/a na nan #n/a #nv null none nil inf -inf +inf -nan -nan(ind) nan(ind) "
    "1.#qnan -1.#ind 1.#inf -1.#inf invalid missing nodata void".split()
)
_VALUE = re.compile(r"[-+]?(\d[\d ',.’\u00a0\u202f]*|[.,]\d+)([eE][-+]?\d+)?")
_THOUSANDS = re.compile(r"[-+]?\d{1,3}([., '’\u00a0\u202f]\d{3})+")
_LOOKED_AT = 2000


def is_value(cell: str) -> bool:
    """Whether a cell looks like a number, a missing one, or a time."""
    return bool(_VALUE.fullmatch(cell)) or cell.lower() in _MISSING or is_clock(cell)


def numbers(name: str, cells: Any, table: Any) -> Column:
    """Numbers of an Arrow column of texts.

    Parameters
    ----------
    table : pyarrow.Table
        The whole of it, whose other columns may show what a comma means.
    """
    from pyarrow import ArrowInvalid

    try:
        return Column(array(cells.cast("float64")))
    except ArrowInvalid:
        pass
    texts = [(text or "").strip().lower() for text in cells.to_pylist()]
    texts = ["" if text == name.lower() else text for text in texts]  # the header again
    known = [text for text in texts if text and text not in _MISSING]
    if not known:
        raise LogError(f"Column {name} holds no numbers.")
    if sum(map(is_clock, known[:_LOOKED_AT])) > len(known[:_LOOKED_AT]) / 2:
        return Column(seconds(name, texts), "s", clock=True)
    point, notes = _decimal(name, known[:_LOOKED_AT], table)
    other = "," if point == "." else "."
    values = np.full(len(texts), np.nan)
    for k, text in enumerate(texts):
        if text and text not in _MISSING:
            values[k] = _number(name, k, text, point, other)
    return Column(values, notes=notes)


def array(column: Any) -> Array:
    """From the buffers: ``to_numpy`` imports pandas, which takes longer than all the rest."""
    whole = column.cast("float64", safe=False)
    whole = whole.combine_chunks() if hasattr(whole, "combine_chunks") else whole
    if not len(whole):
        return np.empty(0)
    values = np.frombuffer(whole.buffers()[1], np.float64, len(whole), 8 * whole.offset)
    missing = np.from_dlpack(whole.is_null().cast("uint8"))
    return np.where(missing, np.nan, values)


def _number(name: str, row: int, text: str, point: str, other: str) -> float:
    plain = re.sub(r"[ '’\u00a0\u202f]", "", text)
    if other in plain:
        whole, dot, fraction = plain.partition(point)
        if other in fraction or not _THOUSANDS.fullmatch(whole):
            plain = "x"
        plain = whole.replace(other, "") + dot + fraction
    plain = plain.replace(point, ".")
    if _VALUE.fullmatch(text) and plain.count(".") < 2:
        return float(plain)
    raise LogError(f"Column {name} has {text[:20]!r} in data row {row + 1}: not a number.")


def _decimal(name: str, cells: list[str], table: Any) -> tuple[str, tuple[str, ...]]:
    """What stands before the fraction: as the column's cells say, or else other columns'."""
    said = _said(cells)
    if said:
        return said, ()
    other = {_said(_few(table.column(k))) for k in range(table.num_columns)} - {""}
    if len(other) == 1:
        return other.pop(), ()
    shown = next((c for c in cells if "," in c), "")
    if not shown:
        return ".", ()
    read = shown.replace(",", ".")
    return ",", (
        f"Column {name}: {shown} was read as {read}; write it without the comma if it is "
        f"{shown.replace(',', '')}.",
    )


def _few(column: Any) -> list[str]:
    return [text.strip() for text in column.slice(0, 200).to_pylist() if text]


def _said(cells: list[str]) -> str:
    """The decimal sign that cells show beyond doubt; nothing where ``18,000`` may be either."""
    votes = {".": 0, ",": 0}
    for cell in cells:
        if "." not in cell and "," not in cell or not _VALUE.fullmatch(cell):
            continue
        if "." in cell and "," in cell:
            votes[max(".,", key=cell.rfind)] += 1
        elif not (_THOUSANDS.fullmatch(cell) and "," in cell):
            votes["." if "." in cell else ","] += 1
        elif cell.count(",") > 1:
            votes["."] += 1
        elif re.match(r"[-+]?0", cell):  # no thousands begin with a zero
            votes[","] += 1
    return "" if votes["."] == votes[","] else max(votes, key=lambda sign: votes[sign])
