"""The flags that say what is in a log, gathered for a vehicle's and for a plant's."""

import functools
from collections.abc import Callable
from itertools import chain
from typing import Any

import click

from tuners.cli.grouped import PLANT, VEHICLE, Flag
from tuners.cli.numbers import ASSIGNMENT, NONZERO, NUMBER, POSITIVE
from tuners.logs import UNITS, Choice, Options
from tuners.logs.columns import ROLES
from tuners.logs.plant_log import SIGNALS, PlantOptions

WORDS = {"steer": "steering", "yaw_rate": "yaw rate", "speed": "speed"}

Decorator = Callable[..., Any]
Make = Callable[..., Decorator]


def log_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the flags of a log; it gets them as `Options` and as `PlantOptions`."""

    @functools.wraps(command)
    def gathered(**given: Any) -> Any:
        columns = {role: given.pop(f"{role}_column") for role in (*ROLES, *SIGNALS)}
        units = {role: given.pop(f"{role}_unit") for role in (*ROLES, *SIGNALS)}
        choice = Choice(_said(columns), _said(units))
        stretch = {name: given.pop(name) for name in ("Ts", "start", "stop")}
        vehicle = Options(
            choice,
            speed=_in_si(given.pop("speed"), units["speed"]),
            steer_ratio=given.pop("steer_ratio"),
            steer_sign=-1 if given.pop("flip_steer") else 1,
            yaw_rate_sign=-1 if given.pop("flip_yaw_rate") else 1,
            steer_is=given.pop("steer_is"),
            **stretch,
        )
        scales = {f"{signal}_scale": given.pop(f"{signal}_scale") for signal in SIGNALS}
        own = PlantOptions(choice, measured=_once(given.pop("measured")), **scales, **stretch)
        return command(vehicle=vehicle, own=own, **given)

    for option in reversed([*_shared(), *_vehicles(), *_plants()]):
        gathered = option(gathered)
    return gathered


def _said(given: dict[str, str | None]) -> dict[str, str]:
    return {role: word for role, word in given.items() if word is not None}


def _once(pairs: tuple[tuple[str, float | str], ...]) -> dict[str, float | str]:
    names = [name for name, _ in pairs]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise click.UsageError(f"--measured {twice} is given twice.")
    return dict(pairs)


def _in_si(speed: float | None, unit: str | None) -> float | None:
    return None if speed is None else speed * UNITS["speed"][unit or "m/s"]


def _column(flag: Make, role: str, words: str) -> Decorator:
    help = f"Column of {words}: its name, or its place from 1."
    return flag(f"--{role.replace('_', '-')}-column", metavar="COLUMN", help=help)


def _unit(flag: Make, role: str, words: str) -> Decorator:
    units = list(UNITS[role])
    help = f"Unit of {words}. [default: what the log says, or {units[0]}]"
    return flag(f"--{role.replace('_', '-')}-unit", type=click.Choice(units), help=help)


def _shared() -> list[Decorator]:
    return [
        _column(click.option, "time", "time"),
        _unit(click.option, "time", "time"),
        click.option("--Ts", "Ts", type=POSITIVE, help="Sampling time [s], instead of a column."),
        click.option("--from", "start", type=NUMBER, help="Use the log from this time on [s]."),
        click.option("--to", "stop", type=NUMBER, help="Use the log up to this time [s]."),
    ]


def _vehicles() -> list[Decorator]:
    flag = functools.partial(click.option, cls=Flag, kind=VEHICLE)
    pairs = [[_column(flag, *of), _unit(flag, *of)] for of in WORDS.items()]
    return [
        *chain(*pairs),
        flag("--speed", type=POSITIVE, help="Constant speed in --speed-unit, instead of a column."),
        flag(
            "--steer-ratio", type=POSITIVE, default=1.0, show_default=True,
            help="Hand-wheel angle over road-wheel angle.",
        ),
        flag(
            "--flip-steer", is_flag=True,
            help="Turn the steering round, where it counts right and the yaw rate left.",
        ),
        flag("--flip-yaw-rate", is_flag=True, help="Turn the yaw rate round."),
        flag(
            "--steer-is", type=click.Choice(["command", "measured"]), default="command",
            show_default=True,
            help="What was recorded: what the actuator was told, or the angle that came of it.",
        ),
    ]  # fmt: skip


def _plants() -> list[Decorator]:
    flag = functools.partial(click.option, cls=Flag, kind=PLANT)
    scale = functools.partial(flag, type=NONZERO, default=1.0, show_default=True)
    unit = "Unit of the {}, as in mV. [default: what the log says, or the plant's]"
    words = "What the {} is multiplied by, once it is in the plant's unit; -1 turns it round."
    return [
        *(_column(flag, signal, f"the {signal}") for signal in SIGNALS),
        *(flag(f"--{signal}-unit", metavar="UNIT", help=unit.format(signal)) for signal in SIGNALS),
        *(scale(f"--{signal}-scale", help=words.format(signal)) for signal in SIGNALS),
        flag(
            "--measured", type=ASSIGNMENT, multiple=True,
            help="What was measured beside the recording: a number, or a column, whose mean it is, "
            "if not the one that is called NAME; can be repeated.",
        ),
    ]  # fmt: skip
