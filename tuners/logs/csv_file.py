"""Text tables: any delimiter, decimal comma, byte order marks, comments, a row of units.

How the table is laid out is found here; its numbers are read by Apache Arrow.  Of the libraries
that find delimiters, ``csv.Sniffer`` takes ``0,1;2,3`` for two commas, DuckDB does not know
decimal commas, and clevercsv no preamble and no row of units.
"""

import csv
import io
import re
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from tuners.logs.table import Array, Column, LogError, Table

DELIMITERS = (";", "\t", "|", ",", " ")
COMMENTS = ("#", "%", "//")
_HEAD = 40  # lines that show how the file is laid out


@dataclass(frozen=True, slots=True)
class Layout:
    """How a text table is laid out.

    Attributes
    ----------
    delimiter, decimal : str
        Between the columns, and before the fraction.
    names, units : tuple of str
        Of the columns; numbers from 1 where the file has no header.
    body : int
        Index of the first line of numbers.
    """

    delimiter: str
    decimal: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    body: int


def read(content: bytes) -> Table:
    """Read a text table."""
    lines = _decoded(content).splitlines()
    kept = [line for line in lines if line.strip() and not line.lstrip().startswith(COMMENTS)]
    layout = find_layout(kept)
    closed = [line for line in kept[layout.body :] if line.count('"') % 2 == 0]
    table, skipped = _parsed(closed, layout)
    skipped += len(kept) - layout.body - len(closed)
    units = dict(zip(layout.names, layout.units, strict=True))

    def column(name: str) -> Column:
        return Column(floats(name, table.column(name)), units[name])

    notes = (f"{skipped} incomplete row{'s' * (skipped > 1)} left out.",) if skipped else ()
    return Table(layout.names, column, notes)


def find_layout(lines: list[str]) -> Layout:
    """Find out how the table in these lines (no comments, none empty) is laid out."""
    if len(lines) < 2:
        raise LogError("The file has no table in it: fewer than two lines of text.")
    delimiter = _delimiter(lines[:_HEAD])
    rows = [_cells(line, delimiter) for line in lines[:_HEAD]]
    width = _width(rows)
    full = [k for k, row in enumerate(rows) if len(row) == width]
    body = next((k for k in full if sum(map(_number, rows[k])) >= min(width, 2)), None)
    if body is None:
        raise LogError(f"No row of numbers in the first {len(rows)} lines.")
    decimal = "," if delimiter != "," and any("," in cell for cell in rows[body]) else "."
    above = [rows[k] for k in full if k < body]
    names = above[0] if above else [str(k + 1) for k in range(width)]
    units = above[1] if len(above) > 1 else [""] * width
    return Layout(delimiter, decimal, _distinct(names), tuple(units), body)


def floats(name: str, column: Any) -> Array:
    """Numbers of an Arrow column; seconds where it holds dates, times and durations."""
    from pyarrow import types

    kind = column.type
    if types.is_timestamp(kind) or types.is_time(kind) or types.is_duration(kind):
        ticks = _array(column.cast(f"int{kind.bit_width}"))
        return np.asarray(ticks * float(np.timedelta64(1, kind.unit) / np.timedelta64(1, "s")))
    if types.is_floating(kind) or types.is_integer(kind) or types.is_decimal(kind):
        return _array(column)
    bad = next((k for k, v in enumerate(column) if v.is_valid and not _number(str(v))), None)
    if bad is None and column.null_count < len(column):
        return np.array([float(str(v).replace(",", ".")) if v.is_valid else np.nan for v in column])
    if bad is None:
        raise LogError(f"Column {name} holds no numbers.")
    cell = str(column[bad])[:20]
    raise LogError(f"Column {name} has {cell!r} in data row {bad + 1}: not a number.")


def _array(column: Any) -> Array:
    """From the buffers: `to_numpy` imports pandas and `cast` all of Arrow's functions."""
    known = str(column.type) in ("int64", "double")
    whole = (column if known else column.cast("float64", safe=False)).combine_chunks()
    if not len(whole):
        return np.empty(0)
    kind = np.int64 if str(whole.type) == "int64" else np.float64
    values = np.frombuffer(whole.buffers()[1], kind, len(whole), 8 * whole.offset)
    if not whole.null_count:
        return values.astype(np.float64)
    return np.where(np.from_dlpack(whole.is_null().cast("uint8")), np.nan, values)


def _decoded(content: bytes) -> str:
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", errors="replace")
    if b"\x00" in content:
        raise LogError("The file is not a text table: it has zero bytes in it.")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _delimiter(lines: list[str]) -> str:
    """The one that most of the last lines agree on; a comma loses to the others."""
    tail = lines[-max(len(lines) // 2, 2) :]
    for delimiter in DELIMITERS:
        rows = [_cells(line, delimiter) for line in tail]
        width = _width(rows)
        if width > 1 and sum(len(row) == width for row in rows) > len(rows) / 2:
            return delimiter
    return ","


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error as error:
        raise LogError(f"The file is not a text table: {error}.") from None


def _width(rows: list[list[str]]) -> int:
    return Counter(map(len, rows)).most_common(1)[0][0]


def _number(cell: str) -> bool:
    return bool(re.fullmatch(r"[-+]?(\d+[.,]?\d*|[.,]\d+)([eE][-+]?\d+)?", cell.strip()))


def _distinct(names: list[str]) -> tuple[str, ...]:
    """Names without repetitions: the second `speed` is `speed_2`."""
    seen: Counter[str] = Counter()
    result: list[str] = []
    for k, name in enumerate(names):
        name = name or f"column {k + 1}"
        seen[name] += 1
        while name in result:
            name = f"{name}_{seen[name]}"
        result.append(name)
    return tuple(result)


def _parsed(lines: list[str], layout: Layout) -> tuple[Any, int]:
    from pyarrow import ArrowInvalid
    from pyarrow import csv as arrow

    blanks = layout.delimiter == " "
    if blanks:
        lines = ["\t".join(line.split()) for line in lines]
    skipped = 0

    def skip(_: Any) -> str:
        nonlocal skipped
        skipped += 1
        return "skip"

    try:
        table = arrow.read_csv(
            io.BytesIO("\n".join(lines).encode()),
            arrow.ReadOptions(column_names=list(layout.names), use_threads=False),
            arrow.ParseOptions(
                delimiter="\t" if blanks else layout.delimiter, invalid_row_handler=skip
            ),
            arrow.ConvertOptions(decimal_point=layout.decimal, strings_can_be_null=True),
        )
    except ArrowInvalid as error:
        raise LogError(f"The table cannot be read: {str(error).splitlines()[0]}") from None
    return table, skipped
