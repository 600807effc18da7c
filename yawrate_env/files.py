"""Atomic file writes."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedWriter
from pathlib import Path


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[BufferedWriter]:
    """Open a temporary file beside `path`, and rename it to `path` if nothing fails.

    A `path` that exists and is no regular file is refused: with sufficient rights, the
    replacement would remove a device such as ``/dev/null`` for all users.
    """
    target = Path(path)
    check_regular(target)
    prefix = f".{target.name}."
    try:
        with _temporary(target, prefix) as file:
            yield file
    except OSError as error:
        if error.errno is None or prefix not in str(error.filename or prefix):
            raise
        raise OSError(error.errno, error.strerror, str(target)) from error
    _sync(target.parent)


@contextmanager
def _temporary(target: Path, prefix: str) -> Iterator[BufferedWriter]:
    """A new file, renamed to `target` once it is closed, and deleted if something fails.

    Windows renames and deletes closed files only.
    """
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=prefix)
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.chmod(name, 0o644)
        os.replace(name, target)
    except BaseException:
        os.unlink(name)
        raise


def check_regular(path: Path) -> None:
    """Refuse a folder, a device, a pipe; a file that does not exist yet is fine."""
    if path.exists() and not path.is_file():
        raise ValueError(f"{path} is no regular file. Give the path of a file to write.")


def check_folder(folder: Path) -> None:
    """Refuse a folder that cannot be written to, before any work."""
    if not folder.is_dir():
        raise ValueError(f"The folder {folder} does not exist. Make it first.")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ValueError(f"The folder {folder} cannot be written to. Choose another.")


def leftovers(path: str | os.PathLike[str]) -> list[Path]:
    """Temporary files of `replacing` whose process was killed; the name may be a pattern."""
    target = Path(path)
    return list(target.parent.glob(f".{target.name}.*"))


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file."""
    with replacing(path) as file:
        file.write(text.encode())


def _sync(folder: Path) -> None:
    """Flush a folder's entries: fsync of a file does not write them.  Windows opens no folders."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
