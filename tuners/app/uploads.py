"""The logs that the page was given: files in one temporary folder, and what became of them."""

import itertools
import re
import shutil
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tuners.logs import Table
    from tuners.tuner.result import Result

LONGEST_NAME = 120


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """A result, and what the command makes of it."""

    result: "Result"
    json: dict[str, Any]
    report: str


@dataclass(slots=True, eq=False)
class Upload:
    """One log.

    Attributes
    ----------
    name : str
        As the user calls the file.
    path : Path
        Where it lies; its name is ours, but for the ending, which tells some formats.
    table : Table or None
        What is in it, once it was read.
    answer : Answer or None
        The last one.
    """

    name: str
    path: Path
    table: "Table | None" = None
    answer: Answer | None = None


class Uploads:
    """Logs by number, in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._numbers = itertools.count(1)
        self._held: dict[int, Upload] = {}

    async def add(self, name: str, chunks: AsyncIterator[bytes]) -> tuple[int, Upload]:
        """Write one as it arrives; nothing of it stays where it does not arrive whole."""
        number, name = next(self._numbers), shown(name)
        place = self.folder / str(number)
        place.mkdir()
        path = place / f"log{_ending(name)}"
        try:
            with path.open("wb") as file:
                async for chunk in chunks:
                    file.write(chunk)
        except BaseException:
            shutil.rmtree(place)
            raise
        self._held[number] = Upload(name, path)
        return number, self._held[number]

    def __getitem__(self, number: int) -> Upload:
        """By its number; `KeyError` where there is none."""
        return self._held[number]

    def remove(self, number: int) -> None:
        """Forget one and delete its file."""
        shutil.rmtree(self._held.pop(number).path.parent)


def shown(name: str) -> str:
    """A file's name without its folders and without what cannot be shown."""
    last = re.split(r"[/\\]", name)[-1]
    return "".join(c for c in last if c.isprintable())[-LONGEST_NAME:] or "log"


def _ending(name: str) -> str:
    found = re.search(r"(\.[A-Za-z0-9]{1,8}){1,2}$", name)
    return found[0].lower() if found else ""
