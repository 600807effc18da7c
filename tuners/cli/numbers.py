"""Types of numbers that the commands take."""

import math
from typing import Any

import click

MOST = 1e9
"""No count is larger: a billion episodes would take a core weeks."""


class Number(click.ParamType):  # type: ignore[type-arg]
    """A finite number, or only a positive one, or only one that is not 0."""

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
            self.fail(f"{value} leaves nothing over.", param, ctx)
        return number


class Count(Number):
    """A positive whole number up to `MOST`; ``1e6`` is one."""

    name = "count"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Parse and check."""
        number = super().convert(value, param, ctx)
        if not float(number).is_integer():
            self.fail(f"{value} is not a whole number.", param, ctx)
        if number > MOST:
            self.fail(f"{value} is above {MOST:g}.", param, ctx)
        return int(number)


class Assignment(Number):
    """A name and a finite number, as in ``speed=20``, or the name of a column.

    What reads as a number is one; in quotes it is a column, ``speed="20"``.
    """

    name = "name=value"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Take apart, and check the number."""
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


NUMBER, POSITIVE, NONZERO = Number(), Number(positive=True), Number(nonzero=True)
COUNT, ASSIGNMENT = Count(positive=True), Assignment()
