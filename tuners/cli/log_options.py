"""The flags that say what is in a log, gathered into `Options`."""

import functools
from collections.abc import Callable
from typing import Any

import click

from tuners.cli.numbers import NUMBER, POSITIVE
from tuners.logs import UNITS, Choice, Options
from tuners.logs.columns import ROLES

WORDS = {
    "time": "time",
    "steer": "steering",
    "yaw_rate": "yaw rate",
    "speed": "speed",
}


def log_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the flags of a log; it gets them as one `Options`."""

    @functools.wraps(command)
    def gathered(**given: Any) -> Any:
        columns = {role: given.pop(f"{role}_column") for role in ROLES}
        units = {role: given.pop(f"{role}_unit") for role in ROLES}
        options = Options(
            Choice(
                {role: name for role, name in columns.items() if name is not None},
                {role: unit for role, unit in units.items() if unit is not None},
            ),
            Ts=given.pop("ts"),
            speed=_in_si(given.pop("speed"), units["speed"]),
            steer_ratio=given.pop("steer_ratio"),
            steer_sign=-1 if given.pop("flip_steer") else 1,
            yaw_rate_sign=-1 if given.pop("flip_yaw_rate") else 1,
            start=given.pop("start"),
            stop=given.pop("stop"),
            steer_is=given.pop("steer_is"),
        )
        return command(options=options, **given)

    for option in reversed(_flags()):
        gathered = option(gathered)
    return gathered


def _in_si(speed: float | None, unit: str | None) -> float | None:
    return None if speed is None else speed * UNITS["speed"][unit or "m/s"]


def _flags() -> list[Callable[..., Any]]:
    flags = []
    for role, words in WORDS.items():
        flag = role.replace("_", "-")
        flags += [
            click.option(
                f"--{flag}-column",
                metavar="COLUMN",
                help=f"Column of {words}: its name, or its place from 1.",
            ),
            click.option(
                f"--{flag}-unit",
                type=click.Choice(list(UNITS[role])),
                help=f"Unit of {words}. [default: what the log says, or {next(iter(UNITS[role]))}]",
            ),
        ]
    return [
        *flags,
        click.option("--Ts", "ts", type=POSITIVE, help="Sampling time [s], instead of a column."),
        click.option(
            "--speed", type=POSITIVE, help="Constant speed in --speed-unit, instead of a column."
        ),
        click.option(
            "--steer-ratio", type=POSITIVE, default=1.0, show_default=True,
            help="Hand-wheel angle over road-wheel angle.",
        ),
        click.option(
            "--flip-steer", is_flag=True,
            help="Turn the steering round, where it counts right and the yaw rate left.",
        ),
        click.option("--flip-yaw-rate", is_flag=True, help="Turn the yaw rate round."),
        click.option(
            "--steer-is", type=click.Choice(["command", "measured"]), default="command",
            show_default=True,
            help="What was recorded: what the actuator was told, or the angle that came of it.",
        ),
        click.option("--from", "start", type=NUMBER, help="Use the log from this time on [s]."),
        click.option("--to", "stop", type=NUMBER, help="Use the log up to this time [s]."),
    ]  # fmt: skip
