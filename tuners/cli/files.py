"""Types of files that the commands take and write."""

import os
from pathlib import Path
from typing import Any

import click

from yawrate_env.files import check_folder, check_regular

READABLE = click.Path(exists=True, dir_okay=False, path_type=Path)


class Output(click.Path):
    """A file to write, or a folder, in a folder that exists."""

    def __init__(self, suffix: str = "", *, folder: bool = False) -> None:
        super().__init__(dir_okay=folder, path_type=Path)
        self.suffix = suffix

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Check the folder and the ending before any work is done."""
        path = Path(os.fsdecode(super().convert(value, param, ctx)))
        inside = self.dir_okay and path.is_dir()
        try:
            check_folder(path if inside else path.parent)
            if not inside:
                check_regular(path)
        except (ValueError, OSError) as error:
            self.fail(str(error), param, ctx)
        if self.suffix and path.suffix != self.suffix:
            self.fail(f"{path} must end in {self.suffix}.", param, ctx)
        return path


def keep(out: Path | None, *sources: str | Path | None) -> None:
    """Refuse to write over a file that the command reads."""
    for source in sources:
        if out is None or source is None or not (out.exists() and Path(source).exists()):
            continue
        if out.samefile(source):
            raise click.UsageError(f"{out} is read, and would be written over. Name another file.")
