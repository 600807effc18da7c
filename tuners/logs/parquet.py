"""Apache Parquet tables."""

from tuners.logs.csv_file import floats
from tuners.logs.table import Column, LogError, Table


def read(content: bytes) -> Table:
    """Read a Parquet file."""
    from pyarrow import ArrowException, BufferReader
    from pyarrow.parquet import ParquetFile

    try:
        table = ParquetFile(BufferReader(content), page_checksum_verification=True).read()
    except (ArrowException, OSError) as error:
        raise LogError(f"The Parquet file cannot be read: {str(error).splitlines()[0]}") from None

    def column(name: str) -> Column:
        return Column(floats(name, table.column(table.column_names.index(name))))

    return Table(tuple(table.column_names), column)
