"""Files that are there completely or not at all."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedWriter
from pathlib import Path


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[BufferedWriter]:
    """Open a temporary file beside `path`, and put it in its place when all went well.

    What is there and is no regular file is refused: for a user with the right to it, the
    replacement would take a device such as ``/dev/null`` away from the whole machine.
    """
    target = Path(path)
    if target.exists() and not target.is_file():
        raise ValueError(f"{target} is no regular file. Give the path of a file to write.")
    handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, target)
    except BaseException:
        os.unlink(temporary)
        raise
    _sync(target.parent)


def leftovers(path: str | os.PathLike[str]) -> list[Path]:
    """Temporary files of `replacing` whose process was killed; the name may be a pattern."""
    target = Path(path)
    return list(target.parent.glob(f".{target.name}.*"))


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file."""
    with replacing(path) as file:
        file.write(text.encode())


def _sync(folder: Path) -> None:
    """Make names in a folder last: a file's own fsync does not write its folder's entry."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
