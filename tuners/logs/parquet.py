"""Apache Parquet, Feather and Arrow tables."""

from io import BytesIO
from typing import Any

import numpy as np

from tuners.logs import cells
from tuners.logs.table import Column, LogError, Table


def read(content: bytes) -> Table:
    """Read a Parquet file."""
    from pyarrow import ArrowException, BufferReader
    from pyarrow.parquet import ParquetFile

    try:
        file = ParquetFile(BufferReader(content), page_checksum_verification=True)
        return _table(file.read())
    except (ArrowException, OSError) as error:
        raise LogError(f"The Parquet file cannot be read: {str(error).splitlines()[0]}") from None


def read_arrow(content: bytes) -> Table:
    """Read a Feather file, or an Arrow stream in a file."""
    from pyarrow import ArrowException, feather

    try:
        return _table(feather.read_table(BytesIO(content)))
    except (ArrowException, OSError) as error:
        raise LogError(f"The Feather file cannot be read: {str(error).splitlines()[0]}") from None


def _table(table: Any) -> Table:
    def column(name: str) -> Column:
        return _column(name, table.column(table.column_names.index(name)), table)

    return Table(tuple(table.column_names), column)


def _column(name: str, column: Any, table: Any) -> Column:
    """Numbers; seconds where a column holds dates, times and durations."""
    from pyarrow import ArrowException, types

    kind = column.type
    if types.is_timestamp(kind) or types.is_time(kind) or types.is_duration(kind):
        ticks = cells.array(column.cast(f"int{kind.bit_width}"))
        return Column(np.asarray(ticks * _tick(kind)), "s", clock=True)
    if types.is_floating(kind) or types.is_integer(kind) or types.is_decimal(kind):
        return Column(cells.array(column))
    try:
        texts = column.cast("string")
    except ArrowException:
        raise LogError(f"Column {name} holds no numbers.") from None
    strings = [i for i, field in enumerate(table.schema) if types.is_string(field.type)]
    return cells.numbers(name, texts, table.select(strings))


def _tick(kind: Any) -> float:
    return float(np.timedelta64(1, kind.unit) / np.timedelta64(1, "s"))
