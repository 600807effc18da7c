"""Which reader a file needs: by its first bytes, so that a wrong ending does not matter."""

from collections.abc import Callable
from pathlib import Path

from tuners.logs import csv_file, matlab, mdf, parquet
from tuners.logs.table import LogError, Table


def read_table(path: Path) -> Table:
    """Read a recording in any known format."""
    try:
        with open(path, "rb") as file:
            head = file.read(128)
    except OSError as error:
        raise LogError(f"{path}: {error.strerror}.") from None
    if not head:
        raise LogError(f"{path} is empty.")
    try:
        return _reader(path, head)(path)
    except LogError as error:
        raise LogError(f"{path}: {error}") from None


def _reader(path: Path, head: bytes) -> Callable[[Path], Table]:
    if head.startswith(b"PAR1"):
        return parquet.read
    if head.startswith((b"MDF     ", b"UnFinMF ")):
        return mdf.read
    if head.startswith(b"MATLAB") or head.startswith(matlab.HDF5) or path.suffix == ".mat":
        return matlab.read
    return csv_file.read
