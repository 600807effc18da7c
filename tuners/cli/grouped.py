"""Flags that belong to one kind of log, in the help and when they are given."""

from typing import Any

import click
from click.core import ParameterSource

VEHICLE, PLANT = "vehicle", "plant"


class Flag(click.Option):
    """A flag for the logs of one kind."""

    def __init__(self, *args: Any, kind: str, **settings: Any) -> None:
        super().__init__(*args, **settings)
        self.kind = kind


class Grouped(click.Command):
    """Shows the flags of each kind under a heading of their own, after those of all kinds."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the sections."""
        options = [p for p in self.get_params(ctx) if isinstance(p, click.Option)]
        shown = [(getattr(p, "kind", ""), p.get_help_record(ctx)) for p in options]
        for kind in ("", VEHICLE, PLANT):
            with formatter.section(f"Options for a {kind}'s log" if kind else "Options"):
                formatter.write_dl([row for of, row in shown if of == kind and row is not None])


def refuse_others(kind: str, tuner: str) -> None:
    """`click.UsageError` where a flag was given that is for logs of another kind."""
    context = click.get_current_context()
    flags = [flag for flag in context.command.params if isinstance(flag, Flag)]
    for flag in flags:
        given = context.get_parameter_source(flag.name or "") is ParameterSource.COMMANDLINE
        if given and flag.kind != kind:
            own = ", ".join(other.opts[0] for other in flags if other.kind == kind)
            raise click.UsageError(
                f"{flag.opts[0]} is for a {flag.kind}'s log, and {tuner} is a {kind}'s tuner. "
                f"A {kind}'s log has {own}."
            )
