"""Types of arguments that click does not have, and checks of several arguments."""

import math
import os
from pathlib import Path
from typing import Any

import click

LARGEST_COUNT = 1e9

UNUSABLE, REFUSED = 1, 3
"""Exit statuses where a log cannot be used, and where gains are refused."""


def example(line: str) -> str:
    """The end of a command's help; click does not wrap it."""
    return f"\b\nExample:\n  {line}"


class Number(click.ParamType):  # type: ignore[type-arg]
    """A finite number; click's own takes ``nan`` and ``inf``."""

    name = "number"

    def __init__(self, positive: bool = False, nonzero: bool = False) -> None:
        self.positive, self.nonzero = positive, nonzero

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Parse and check."""
        number = click.FLOAT.convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        if self.positive and number <= 0:
            self.fail(f"{value} is not above 0.", param, ctx)
        if self.nonzero and number == 0:
            self.fail("0 is not allowed.", param, ctx)
        return number


class Count(Number):
    """A positive integer; ``1e6`` is one."""

    name = "count"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Parse and check."""
        number = super().convert(value, param, ctx)
        if not float(number).is_integer():
            self.fail(f"{value} is not an integer.", param, ctx)
        if number > LARGEST_COUNT:
            self.fail(f"{value} is above {LARGEST_COUNT:g}.", param, ctx)
        return int(number)


class Assignment(Number):
    """A name and a finite number or the name of a column: ``speed=20``, ``speed=v_wheel``.

    Values that read as numbers are numbers; a column of such a name is quoted: ``speed="20"``.
    """

    name = "name=value"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Split, and check the number."""
        name, _, given = (part.strip() for part in str(value).partition("="))
        if not (name and given):
            self.fail(f"{value!r} is not of the form NAME=VALUE.", param, ctx)
        if len(given) > 2 and given[0] == given[-1] and given[0] in "'\"":
            return name, given[1:-1]
        try:
            float(given)
        except ValueError:
            return name, given
        return name, super().convert(given, param, ctx)


class NameAndText(Assignment):
    """A name and a text, as in ``steam=valve``."""

    name = "name=column"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The name and the text, or wrong usage."""
        name, _, given = (part.strip() for part in str(value).partition("="))
        if not (name and given):
            self.fail(f"{value!r} is not of the form NAME=COLUMN.", param, ctx)
        return name, given


class Output(click.Path):
    """A file or folder to write, in a folder that exists."""

    def __init__(self, suffix: str = "", *, folder: bool = False) -> None:
        super().__init__(dir_okay=folder, path_type=Path)
        self.suffix = suffix

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Check the folder and the suffix before any work is done."""
        from yawrate_env.files import check_folder, check_regular

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


NUMBER, POSITIVE, NONZERO = Number(), Number(positive=True), Number(nonzero=True)
COUNT, ASSIGNMENT, NAMED = Count(positive=True), Assignment(), NameAndText()
READABLE = click.Path(exists=True, dir_okay=False, path_type=Path)
SEED = click.IntRange(min=0)

vehicle_option = click.option(
    "--vehicle",
    "--plant",
    "vehicle",
    type=READABLE,
    help="TOML file of a vehicle or of another plant, or the Python file of a plant called plant. "
    "[default: the paper's vehicle]",
)


def refuse_overwriting(out: Path | None, *sources: str | Path | None) -> None:
    """Refuse to write over a file that the command reads."""
    for source in sources:
        if out is None or source is None or not (out.exists() and Path(source).exists()):
            continue
        if out.samefile(source):
            raise click.UsageError(f"{out} is an input and would be overwritten: name another.")
