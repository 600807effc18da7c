"""The page's form, which has the fields of `yawrate tune`'s options and is parsed like these."""

import shlex
from collections.abc import Mapping
from typing import Any

import click

from tuners.cli.log_options import log_options
from tuners.cli.target_options import Changes, target_options
from tuners.cli.tuning import start_option, tuner_option
from tuners.logs import Options

TEXTS = (
    "time-column", "time-unit", "input-column", "input-unit", "output-column", "output-unit",
    "speed-column", "speed-unit", "speed", "reference-column", "Ts", "steer-ratio", "input-is",
    "input-between", "from", "to", "start", "tuner", "old-kp", "old-Ti",
    "phase-margin", "crossover", "delay",
)  # fmt: skip
FLAGS = "flip-input", "flip-output"
"""Fields, named as the options; none of them names a file of this machine."""

LONGEST = 200

Parsed = tuple[Options, str, str | None, Changes]
"""Options, how the recording starts, the tuner's name if one was chosen, and another loop."""


def arguments(form: Mapping[str, Any]) -> list[str]:
    """The command's options, as it would be given them; empty fields are left out."""
    found = []
    for name, value in form.items():
        if name in FLAGS and isinstance(value, bool):
            found += [f"--{name}"] * value
        elif name not in TEXTS or not isinstance(value, str) or len(value) > LONGEST:
            raise ValueError(f"The form's field {name[:40]!r} is unknown or no text.")
        elif value.strip():
            found.append(f"--{name}={value.strip()}")
    return found


def parsed(form: Mapping[str, Any], tuners: tuple[str, ...]) -> Parsed:
    """The form as the command reads it; click's errors are the command's."""
    found: Parsed = _command.main(arguments(form), "yawrate tune", standalone_mode=False)
    tuner = found[2]
    if tuner is not None and tuner not in tuners:
        raise click.UsageError(f"No tuner {tuner!r}. Choose one of {', '.join(tuners)}.")
    return found


def command_line(form: Mapping[str, Any], name: str) -> str:
    """The command that answers the same."""
    return shlex.join(["yawrate", "tune", name, *arguments(form)])


@click.command(add_help_option=False)
@log_options
@start_option
@tuner_option
@target_options
def _command(options: Options, start: str, tuner: str | None, target: Changes) -> Parsed:
    return options, start, tuner, target
