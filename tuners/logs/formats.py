"""Choose a file's reader by its first bytes, so that a wrong suffix does not matter."""

from collections.abc import Callable
from pathlib import Path

from tuners.logs import csv_file, matlab, mdf, parquet
from tuners.logs.table import LogError, Table


def read_table(path: Path) -> Table:
    """Read a recording in any known format; the file, which may be a pipe, is read once."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise LogError(f"{path}: {error.strerror}.") from None
    if not content:
        raise LogError(f"{path} is empty.")
    try:
        return _reader(content, path.suffix)(content)
    except LogError as error:
        raise LogError(f"{path}: {error}") from None


def _reader(content: bytes, suffix: str) -> Callable[[bytes], Table]:
    if content.startswith(b"PAR1"):
        return parquet.read
    if content.startswith((b"MDF     ", b"UnFinMF ")):
        return mdf.read
    if content.startswith((b"MATLAB", matlab.HDF5)) or suffix == ".mat":
        return matlab.read
    return csv_file.read
