"""Choose a file's reader by its first bytes, so that a wrong suffix does not matter."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path

from tuners.logs import source
from tuners.logs.table import LogError, Table

Reader = Callable[[bytes], Table]

_READERS = {
    b"PAR1": "parquet:read",
    b"ARROW1": "parquet:read_arrow",
    b"FEA1": "parquet:read_arrow",
    b"MDF ": "mdf:read",
    b"UnFinMF ": "mdf:read",
    b"MATLAB": "matlab:read",
    b"\x89HDF\r\n\x1a\n": "matlab:read",
    b"PK\x03\x04": "spreadsheet:read",
    b"\xd0\xcf\x11\xe0": "spreadsheet:read",
    b"\x89MCAP0\r\n": "mcap_file:read",
}
"""Modules and functions by how a file begins."""

_FOREIGN = {
    b"#ROSBAG V2.0": ("a ROS 1 bag", "convert it to MCAP (`mcap convert log.bag log.mcap`)"),
    b"SQLite format 3": (
        "an SQLite database, perhaps a ROS 2 bag",
        "convert it to MCAP (`ros2 bag convert`), or export CSV",
    ),
    b"ULog": ("a PX4 log (ULog)", "export CSV (`ulog2csv`)"),
    b"TDSm": ("a LabVIEW file (TDMS)", "export CSV"),
    b"%PDF": ("a PDF", "export CSV"),
    b"\x93NUMPY": ("a NumPy array", "write CSV (`numpy.savetxt`)"),
    b"\x80\x04": ("a Python pickle", "write CSV or Parquet"),
    b"\x80\x05": ("a Python pickle", "write CSV or Parquet"),
    b"7z\xbc\xaf\x27\x1c": ("a 7-Zip archive", "unpack it"),
    b"Rar!": ("a RAR archive", "unpack it"),
    b"\x04\x22\x4d\x18": ("compressed with LZ4", "unpack it"),
    b"{": ("JSON", "export CSV"),
    b"[{": ("JSON", "export CSV"),
    b"[[": ("JSON", "export CSV"),
    b"<?xml": ("XML", "export CSV"),
    b"<html": ("a web page", "export CSV"),
    b"<!DOCTYPE": ("a web page", "export CSV"),
    b"CarMaker": ("a CarMaker file", "export CSV or MATLAB"),
}
"""What is known and not read, and the way out, by how a file begins."""


def read_table(path: Path, dbc: Path | None = None) -> Table:
    """Read a recording in any known format; the file, which may be a pipe, is read once.

    Parameters
    ----------
    path : Path
        Of the file; its ending matters where its first bytes do not tell the format.
    dbc : Path, optional
        File of the signals in a CAN trace.
    """
    try:
        content = source.read(path)
        if not content:
            raise LogError("The file is empty.")
        reader = _reader(content, path.suffix, dbc)
        if dbc is not None and not isinstance(reader, partial):
            raise LogError(f"This is no CAN trace, and --dbc {dbc} is of one. Leave it out.")
        return replace(reader(content), source=path)
    except LogError as error:
        raise LogError(f"{path}: {error}") from None


def _reader(content: bytes, suffix: str, dbc: Path | None) -> Reader:
    for magic, reader in _READERS.items():
        if content.startswith(magic):
            return _imported(reader)
    if content.startswith(b"LOGG"):
        return partial(_imported("can_bus:read"), dbc=dbc)
    if b"\x89HDF\r\n\x1a\n" in content[:1024] or suffix == ".mat":
        return _imported("matlab:read")
    if content[257:262] == b"ustar":
        raise LogError("This is a tar archive, which is not read: unpack it.")
    for magic, (what, remedy) in _FOREIGN.items():
        if content.lstrip()[: len(magic)] == magic:
            raise LogError(f"This is {what}, which is not read: {remedy}.")
    if content[:400].lstrip().startswith(b"date ") and b"base " in content[:400]:
        return partial(_imported("can_bus:read_asc"), dbc=dbc)
    return _imported("csv_file:read")


def _imported(reader: str) -> Callable[..., Table]:
    module, _, function = reader.partition(":")
    found: Callable[..., Table] = getattr(import_module(f"tuners.logs.{module}"), function)
    return found
