"""A file's bytes, read once: regular files, pipes and process substitution, compressed or not.

Devices are refused, and so are pipes into which nobody writes, which would hang; what is larger
than `LARGEST` is refused before it is in memory.
"""

import io
import os
import select
import stat
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from tuners.logs.table import LogError

LARGEST = 1 << 30
"""Bytes of a recording, unpacked."""

PATIENCE = 10.0
"""How long a pipe may be silent [s]; Windows waits for sockets only."""

_AT_ONCE = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)  # as the system has them
_CHUNK = 1 << 20
_OFFICE = ("[Content_Types].xml", "mimetype")  # spreadsheets are zip files too


def read(path: Path) -> bytes:
    """Read a file once, and unpack it."""
    return unpacked(_whole(path))


def unpacked(content: bytes) -> bytes:
    """The bytes within gzip, bzip2, xz, zstd, or a zip file of one member."""
    for magic, opened in _OPENERS.items():
        if content.startswith(magic):
            try:
                return _limited(opened(content))
            except LogError:
                raise
            except Exception as error:  # every unpacker has its own
                why = str(error) or type(error).__name__
                raise LogError(f"The compressed file is damaged: {why}") from None
    return content


def _whole(path: Path) -> bytes:
    try:
        # A pipe without a writer would block when it is opened.
        handle = os.open(path, os.O_RDONLY | _AT_ONCE)
    except OSError as error:
        raise LogError(f"{error.strerror}.") from None
    with os.fdopen(handle, "rb", buffering=0) as file:
        kind = os.fstat(handle)
        if stat.S_ISDIR(kind.st_mode):
            raise LogError("This is a folder. Give a file.")
        if not (stat.S_ISREG(kind.st_mode) or stat.S_ISFIFO(kind.st_mode)):
            raise LogError("This is a device or socket, no file. Give a file or a pipe.")
        if kind.st_size > LARGEST:
            raise _too_large()
        return b"".join(_chunks(file, stat.S_ISFIFO(kind.st_mode)))


def _chunks(file: io.FileIO, pipe: bool) -> list[bytes]:
    chunks: list[bytes] = []
    size = 0
    while True:
        if pipe and sys.platform != "win32" and not select.select([file], [], [], PATIENCE)[0]:
            raise LogError(
                f"Nothing came through the pipe for {PATIENCE:g} s. Write to a file first."
            )
        chunk = file.read(_CHUNK)
        if not chunk:
            return chunks
        chunks.append(chunk)
        size += len(chunk)
        if size > LARGEST:
            raise _too_large()


def _limited(file: BinaryIO) -> bytes:
    content = file.read(LARGEST + 1)
    if len(content) > LARGEST:
        raise _too_large()
    return content


def _too_large() -> LogError:
    return LogError(
        f"The file has more than {LARGEST >> 30} GiB. Export the channels that matter, or a part."
    )


def _gzip(content: bytes) -> BinaryIO:
    import gzip

    return gzip.open(io.BytesIO(content))  # type: ignore[return-value]


def _bz2(content: bytes) -> BinaryIO:
    import bz2

    return bz2.open(io.BytesIO(content))  # type: ignore[return-value]


def _xz(content: bytes) -> BinaryIO:
    import lzma

    return lzma.open(io.BytesIO(content))  # type: ignore[return-value]


def _zstd(content: bytes) -> BinaryIO:
    import pyarrow

    return pyarrow.CompressedInputStream(pyarrow.BufferReader(content), "zstd")  # type: ignore[no-any-return]


def _zip(content: bytes) -> BinaryIO:
    """The one member that is a file; spreadsheets stay as they are."""
    archive = zipfile.ZipFile(io.BytesIO(content))
    names = archive.namelist()
    if set(_OFFICE) & set(names):
        return io.BytesIO(content)
    files = [name for name in names if not name.endswith("/") and "__MACOSX" not in name]
    if len(files) != 1:
        listed = ", ".join(files[:6]) or "nothing"
        raise LogError(f"The zip file holds {listed}: unpack it and give one of them.")
    return archive.open(files[0])  # type: ignore[return-value]


_OPENERS: dict[bytes, Callable[[bytes], BinaryIO]] = {
    b"\x1f\x8b": _gzip,
    b"BZh": _bz2,
    b"\xfd7zXZ\x00": _xz,
    b"\x28\xb5\x2f\xfd": _zstd,
    b"PK\x03\x04": _zip,
}
