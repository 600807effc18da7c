"""Options that say what is in a log, gathered into one `Options`."""

import functools
from collections.abc import Callable, Mapping
from typing import Any

import click

from tuners.cli.arguments import ASSIGNMENT, NAMED, NONZERO, NUMBER, POSITIVE, READABLE
from tuners.logs import Options
from yawrate_env.signals.hold import HOLDS

Decorator = Callable[..., Any]

ROLES: dict[str, tuple[str, ...]] = {
    "time": (),
    "input": ("steer",),
    "output": ("yaw-rate",),
    "speed": (),
}
"""Roles that have options of their own, and further names of these options."""

UNITS = {"time": "ms", "input": "deg", "output": "deg/s", "speed": "km/h"}
"""Examples for the help."""

SPEED = "speed"


def log_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options of a log; it gets them as `Options`."""

    @functools.wraps(command)
    def gathered(**given: Any) -> Any:
        columns = {role: given.pop(f"{role}_column") for role in (*ROLES, "reference")}
        units = {role: given.pop(f"{role}_unit") for role in ROLES}
        _check_time(given["Ts"], columns["time"], units["time"])
        _check_hold(given["input_is"], given["between"])
        _check_stretch(given["begin"], given["end"])
        _check_scales(given)
        values = {SPEED: given.pop("speed")}
        measured = _once(given.pop("measured"), _given(columns) | _given(values))
        columns |= {name: value for name, value in measured.items() if isinstance(value, str)}
        columns |= _once(given.pop("named"), _given(columns), "--column")
        values |= {name: value for name, value in measured.items() if not isinstance(value, str)}
        scales = {
            signal: (-1.0 if given.pop(f"flip_{signal}") else 1.0) * given.pop(f"{signal}_scale")
            for signal in ("input", "output")
        }
        drove = given.pop("old_kp"), given.pop("old_ti")
        if (drove[0] is None) != (drove[1] is None):
            raise click.UsageError("--old-kp and --old-Ti belong together: give both.")
        options = Options(
            columns=_given(columns),
            units=_given(units),
            values=_given(values),
            input_scale=scales["input"] / given.pop("steer_ratio"),
            output_scale=scales["output"],
            Ts=given.pop("Ts"),
            start=given.pop("begin"),
            stop=given.pop("end"),
            input_is=given.pop("input_is"),
            drove=None if drove[0] is None else drove,
            between=given.pop("between"),
            dbc=given.pop("dbc"),
        )
        return command(options=options, **given)

    for option in reversed(_options()):
        gathered = option(gathered)
    return gathered


def _given(options: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}


def _check_time(Ts: float | None, column: str | None, unit: str | None) -> None:
    """Refuse a sampling time beside a time column or its unit."""
    for flag, value in (("--time-column", column), ("--time-unit", unit)):
        if Ts is not None and value is not None:
            raise click.UsageError(
                f"--Ts {Ts:g} and {flag} {value} contradict each other: --Ts, in seconds, takes "
                "the place of a time column. Leave out one of the two."
            )


def _check_hold(input_is: str, between: str | None) -> None:
    """Refuse held samples of an actuator's position, which is joined by lines."""
    if input_is == "measured" and between == "held":
        raise click.UsageError(
            "--input-is measured and --input-between held contradict each other: an actuator's "
            "measured position is joined by lines. Leave out one of the two."
        )


def _check_stretch(begin: float | None, end: float | None) -> None:
    """Refuse a stretch that ends before it begins."""
    if begin is not None and end is not None and not begin < end:
        raise click.UsageError(f"--from {begin:g} must lie before --to {end:g}.")


def _check_scales(given: Mapping[str, Any]) -> None:
    """Refuse scales that would undo each other, or count twice."""
    if given["steer_ratio"] != 1 and given["input_scale"] != 1:
        raise click.UsageError(
            f"--steer-ratio {given['steer_ratio']:g} and --input-scale {given['input_scale']:g} "
            "both scale the input. Leave out one of the two."
        )
    for signal in ("input", "output"):
        if given[f"flip_{signal}"] and given[f"{signal}_scale"] < 0:
            raise click.UsageError(
                f"--flip-{signal} and --{signal}-scale {given[f'{signal}_scale']:g} undo each "
                "other's sign. Leave out one of the two."
            )


def _once(
    pairs: tuple[tuple[str, Any], ...], others: Mapping[str, Any], flag: str = "--measured"
) -> dict[str, Any]:
    """Assignments by name; each name once, and not by another option too."""
    names = [name for name, _ in pairs]
    twice = next((name for name in names if names.count(name) > 1 or name in others), None)
    if twice is not None:
        raise click.UsageError(f"{flag} {twice} is given twice.")
    return dict(pairs)


def _names(role: str, ending: str) -> list[str]:
    return [f"--{name}-{ending}" for name in (role, *ROLES[role])]


def _column(role: str) -> Decorator:
    help = f"Name of the {role} column, or its number from 1."
    return click.option(*_names(role, "column"), f"{role}_column", metavar="COLUMN", help=help)


def _unit(role: str) -> Decorator:
    help = f"Unit of the {role}, such as {UNITS[role]}. [default: the log's or the plant's]"
    return click.option(*_names(role, "unit"), f"{role}_unit", metavar="UNIT", help=help)


def _scale(signal: str) -> Decorator:
    help = f"Factor for the {signal}, once it is in the plant's unit."
    return click.option(f"--{signal}-scale", type=NONZERO, default=1.0, show_default=True,
                        help=help)  # fmt: skip


def _flip(signal: str) -> Decorator:
    names = [f"--flip-{name}" for name in (signal, *ROLES[signal])]
    help = f"Reverse the sign of the {signal}."
    return click.option(*names, f"flip_{signal}", is_flag=True, help=help)


def _options() -> list[Decorator]:
    option = click.option
    return [
        *(make(role) for role in ROLES for make in (_column, _unit)),
        *(make(signal) for signal in ("input", "output") for make in (_scale, _flip)),
        option("--reference", "--reference-column", "reference_column", metavar="COLUMN",
               help="Name or number of the column with the reference of the closed loop in which "
               "the log was recorded, in the output's unit."),
        option("--steer-ratio", type=POSITIVE, default=1.0, show_default=True,
               help="Hand-wheel angle over road-wheel angle: divides the input."),
        option("--speed", type=POSITIVE,
               help="A constant speed in --speed-unit, for plants that measure one."),
        option("--measured", type=ASSIGNMENT, multiple=True,
               help="A measured parameter of the plant: a number in its unit, or the column whose "
               "mean it is, if that is not called NAME; can be repeated."),
        option("--column", "named", type=NAMED, multiple=True,
               help="Column of the signal NAME, of plants with several inputs and outputs; can be "
               "repeated."),
        option("--input-is", "--steer-is", "input_is", default="command", show_default=True,
               type=click.Choice(["command", "measured"]),
               help="Whether the input was recorded before or after the plant's actuator."),
        option("--input-between", "between", type=click.Choice(HOLDS),
               help="Whether the input keeps a sample's value until the next, as a digital output "
               "does, or is joined by lines, as a measured one. [default: the plant's]"),
        option("--old-kp", type=NONZERO,
               help="kp of the PI that drove, where the log was recorded in a closed loop and has "
               "no reference: that is then rebuilt.  In the plant's units, as kp in the answer."),
        option("--old-Ti", "old_ti", type=POSITIVE, help="Ti of that PI [s]."),
        option("--Ts", "Ts", type=POSITIVE, help="Sampling time [s], instead of a column."),
        option("--dbc", type=READABLE, help="File of the signals in a CAN trace (BLF, ASC)."),
        option("--from", "begin", type=NUMBER, help="Use the log from this time on [s]."),
        option("--to", "end", type=NUMBER, help="Use the log up to this time [s]."),
    ]  # fmt: skip
