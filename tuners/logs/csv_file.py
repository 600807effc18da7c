"""Text tables: any delimiter, decimal comma, encoding, preamble, comments, a row of units.

How the table is laid out is found here; its cells are split by Apache Arrow.  Of the libraries
that find layouts, Polars and Arrow fail on seven of ten (preambles, units, blanks, decimal
commas …), clevercsv on four, and DuckDB, on three, reads neither decimal commas nor blanks and
wants a path, where a pipe has none.
"""

import csv
import io
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from tuners.logs.cells import is_value, numbers
from tuners.logs.table import Column, LogError, Table
from tuners.logs.text import decoded

DELIMITERS = (";", "\t", "|", ",", " ")
COMMENT = re.compile(r"\s*(?:#|%|//)\s*")
LARGEST = 1 << 28
"""Bytes of text."""

_SAMPLE = 1 << 15  # characters in the middle of the file that show how the table is laid out
_ENOUGH = 50  # rows of numbers, after which no header is expected
_ABOVE = 12  # rows of text that may stand above them


@dataclass(frozen=True, slots=True)
class Layout:
    """How a text table is laid out.

    Attributes
    ----------
    delimiter : str
        Between the columns.
    names, units : tuple of str
        Of the columns; numbers from 1 where the file has no header.
    width : int
        How many cells a row has: trailing delimiters make more than there are names.
    body : int
        Position of the first row of numbers in the text.
    """

    delimiter: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    width: int
    body: int


def read(content: bytes) -> Table:
    """Read a text table."""
    if len(content) > LARGEST:
        raise LogError(
            f"The text has more than {LARGEST >> 20} MiB. Export the columns that matter."
        )
    return table_of(decoded(content))


def table_of(text: str) -> Table:
    """The table in a text whose lines end with newlines."""
    layout = find_layout(text)
    body, quoted = _body(text[layout.body :], layout)
    cells, skipped = _split(body, layout)
    skipped += quoted
    units = dict(zip(layout.names, layout.units, strict=True))

    def column(name: str) -> Column:
        found = numbers(name, cells.column(name), cells)
        return found if found.clock else replace(found, unit=units[name])

    notes = (f"{skipped} incomplete row{'s' * (skipped > 1)} left out.",) if skipped else ()
    return Table(layout.names, column, notes)


def find_layout(text: str) -> Layout:
    """Find out how the table in a text is laid out: by its middle, and then from the top."""
    lines = _middle(text)
    if text.count("\n", 0, 1000) < 2 and len(list(_lines(text))) < 2:
        raise LogError("The file has no table in it: fewer than two lines of text.")
    delimiter = _delimiter(lines)
    width = _width([cells_of(line, delimiter) for line in lines])
    above, body = _top(text, delimiter, width)
    if body is None:
        raise LogError("No row of numbers is in this text. Give a table with a column a signal.")
    names, units = _header(above, width)
    full = width
    while len(names) > 1 and not names[-1] and not _used(lines, delimiter, len(names) - 1):
        names, units = names[:-1], units[:-1]
    return Layout(delimiter, _distinct(names), tuple(units), full, body)


def cells_of(line: str, delimiter: str) -> list[str]:
    """A line's cells; a quote that is not closed ends with the line."""
    if delimiter == " ":
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error as error:
        raise LogError(f"The file is not a text table: {error}.") from None


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Lines that are not empty and no comments, and where they begin."""
    start = 0
    while start < len(text):
        end = text.find("\n", start)
        end = len(text) if end < 0 else end
        line = text[start:end]
        if line.strip():
            yield start, line
        start = end + 1


def _middle(text: str) -> list[str]:
    """Lines in the middle of the text, or the second half of a few."""
    if len(text) > 4 * _SAMPLE:
        part = text[len(text) // 2 : len(text) // 2 + _SAMPLE]
        lines = part.split("\n")[1:-1] or part.split("\n")
    else:
        lines = text.split("\n")
        lines = lines[len(lines) // 2 - 1 :]
    return [line for line in lines[:400] if line.strip() and not COMMENT.match(line)]


def _delimiter(lines: list[str]) -> str:
    """The one that most lines agree on, and that leaves most numbers; a comma loses to others."""
    best, score = ",", 0.0
    for delimiter in DELIMITERS:
        rows = [cells_of(line, delimiter) for line in lines]
        width = _width(rows)
        even = [row for row in rows if len(row) == width]
        cells = [cell for row in even for cell in row if cell]
        values = sum(map(is_value, cells)) / max(len(cells), 1)
        found = (width > 1) * len(even) / max(len(rows), 1) * (0.1 + values)
        if found > 1.05 * score:
            best, score = delimiter, found
    return best


def _width(rows: list[list[str]]) -> int:
    return Counter(map(len, rows)).most_common(1)[0][0] if rows else 1


def _top(text: str, delimiter: str, width: int) -> tuple[list[list[str]], int | None]:
    """Rows of text above the numbers, and where these begin: below the last row of names.

    A preamble may have rows of numbers too; a header that is repeated further down is none.
    """
    above: list[list[str]] = []
    body, count, heads = None, 0, set()
    for start, record in _records(text):
        commented = COMMENT.match(record)
        cells = cells_of(record[commented.end() :] if commented else record, delimiter)
        fits = width - 1 <= len(_trimmed(cells)) <= width or len(cells) == width
        values = sum(map(is_value, cells))
        named = (
            not values and sum(bool(re.search(r"[^\W\d_]", c)) for c in cells) >= (width + 1) / 2
        )
        if commented and not (fits and named and body is None):
            continue
        if fits and named and tuple(cells) not in heads:
            if body is not None:
                above, body, count = [], None, 0
            heads.add(tuple(cells))
            above = [*above[1 - _ABOVE :], cells]
        elif len(cells) == width and values >= min(width, 2) and not commented:
            body = start if body is None else body
            count += 1
            if count >= _ENOUGH:
                break
        elif body is None and not fits:
            above = []
    return above, body


def _records(text: str) -> Iterator[tuple[int, str]]:
    """Lines, those joined that a quoted cell of the header spans; and where they begin."""
    begin, parts = 0, ""
    for start, line in _lines(text):
        begin, parts = (begin, f"{parts} {line}") if parts else (start, line)
        if parts.count('"') % 2 and parts.count("\x00") < 1 and len(parts) < 2000:
            nxt = text[start + len(line) + 1 : start + len(line) + 400].split("\n")[0]
            if '"' in nxt or not re.match(r"\s*[-+\d.,]", nxt):
                continue
        yield begin, parts
        parts = ""
    if parts:
        yield begin, parts


def _header(above: list[list[str]], width: int) -> tuple[list[str], list[str]]:
    """Names and units from the rows of text right above the numbers."""
    above = [(row + [""] * width)[:width] for row in above]
    if not above:
        return [str(k + 1) for k in range(width)], [""] * width
    names, units = above[-1], [""] * width
    if len(above) > 1 and _are_units(above[-1], above[-2]):
        names, units = above[-2], above[-1]
    return names, units


def _are_units(row: list[str], names: list[str]) -> bool:
    """Whether a row below names holds units: brackets, or what the names would not be."""
    filled = [cell for cell in row if cell]
    bracketed = sum(bool(re.fullmatch(r"\[.*\]|\(.*\)|-|1|%", cell)) for cell in filled)
    if bracketed >= len(filled) / 2:
        return True
    from tuners.logs.units import known

    units = sum(known(cell) for cell in filled)
    others = sum(known(cell) for cell in names if cell)
    return units >= len(filled) / 2 and units >= others


def _used(lines: list[str], delimiter: str, k: int) -> bool:
    """Whether a column without a name holds anything."""
    return any(len(row) > k and row[k] for row in (cells_of(x, delimiter) for x in lines))


def _trimmed(cells: list[str]) -> list[str]:
    """Without empty cells at the end."""
    end = len(cells)
    while end and not cells[end - 1]:
        end -= 1
    return cells[:end]


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


def _body(text: str, layout: Layout) -> tuple[str, int]:
    """The rows as Arrow takes them, and how many were left out for a quote that is not closed."""
    lost = 0
    if re.search(r"(?m)^\s*(?:#|%|//)", text):
        text = re.sub(r"(?m)^\s*(?:#|%|//).*\n?", "", text)
    if '"' in text:
        lines = text.split("\n")
        closed = [line for line in lines if line.count('"') % 2 == 0]
        lost, text = len(lines) - len(closed), "\n".join(closed)
    if layout.delimiter == " ":
        text = re.sub(r"(?m)^[ \t]+|[ \t]+$", "", text)
        text = re.sub(r"[ \t]+", "\t", text)
    return text, lost


def _split(text: str, layout: Layout) -> tuple[Any, int]:
    """An Arrow table of texts, and how many rows were left out for their length."""
    import pyarrow as pa
    from pyarrow import csv as arrow

    skipped = 0

    def skip(_: Any) -> str:
        nonlocal skipped
        skipped += 1
        return "skip"

    extra = [f"\x00{k}" for k in range(layout.width - len(layout.names))]
    names = [*layout.names, *extra]
    try:
        table = arrow.read_csv(
            io.BytesIO(text.encode()),
            arrow.ReadOptions(column_names=names, use_threads=False),
            arrow.ParseOptions(
                delimiter="\t" if layout.delimiter == " " else layout.delimiter,
                invalid_row_handler=skip,
            ),
            arrow.ConvertOptions(
                column_types=dict.fromkeys(names, pa.string()),
                null_values=[""],
                strings_can_be_null=True,
                quoted_strings_can_be_null=True,
            ),
        )
    except pa.ArrowInvalid as error:
        raise LogError(f"The table cannot be read: {str(error).splitlines()[0]}") from None
    return table, skipped
