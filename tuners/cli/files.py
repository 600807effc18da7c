"""Types of files that the commands take and write."""

import os
from pathlib import Path
from typing import Any

import click

READABLE = click.Path(exists=True, dir_okay=False, path_type=Path)


class Output(click.Path):
    """A file to write, or a folder, in a folder that exists."""

    def __init__(self, suffix: str = "", *, folder: bool = False) -> None:
        super().__init__(dir_okay=folder, path_type=Path)
        self.suffix = suffix

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Check the folder and the ending before any work is done."""
        path = Path(os.fsdecode(super().convert(value, param, ctx)))
        if not path.parent.is_dir():
            self.fail(f"The folder {path.parent} does not exist.", param, ctx)
        if self.suffix and path.suffix != self.suffix:
            self.fail(f"{path} must end in {self.suffix}.", param, ctx)
        return path
