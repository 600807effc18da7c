"""Options that ask for another loop than a tuner was made for."""

import functools
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import click

from tuners.cli.arguments import NUMBER, POSITIVE
from yawrate_env.loop.target import Target
from yawrate_env.plant.plant import Plant

Changes = Mapping[str, float]
"""Given options by their names."""

_WHOLE = 1e-6  # of a sample


def target_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options of a loop's target; it gets those given as `target`."""

    @functools.wraps(command)
    def gathered(**given: Any) -> Any:
        changes = {name: given.pop(name) for name in ("phase_margin", "crossover", "delay")}
        changes = {name: value for name, value in changes.items() if value is not None}
        return command(target=changes, **given)

    for option in reversed(_OPTIONS):
        gathered = option(gathered)
    return gathered


def changed(plant: Plant, changes: Changes) -> Target:
    """The plant's target with changes; wrong usage where it has none or cannot have these."""
    target = plant.loop_target
    if target is None:
        flag = "--" + next(iter(changes)).replace("_", "-")
        raise click.UsageError(
            f"{flag}: this tuner's plant has no PI loop with a target. Leave it out."
        )
    settings: dict[str, Any] = dict(changes)
    if (delay := settings.pop("delay", None)) is not None:
        samples = delay / target.Ts
        if delay < 0 or abs(samples - round(samples)) > _WHOLE:
            raise click.UsageError(
                f"--delay {delay:g} is not 0 or a whole number of the controller's samples of "
                f"{target.Ts:g} s. Round it up."
            )
        target = replace(target, delay_samples=round(samples))
    try:
        return replace(target, **settings)
    except ValueError as error:
        raise click.UsageError(str(error)) from None


_OPTIONS = [
    click.option("--phase-margin", type=POSITIVE, metavar="DEG",
                 help="Phase margin to design for, instead of the tuner's [deg]."),
    click.option("--crossover", type=POSITIVE, metavar="HZ",
                 help="Crossover to design for, instead of the tuner's [Hz]."),
    click.option("--delay", type=NUMBER, metavar="S",
                 help="Computation delay of the controller, instead of the tuner's [s]."),
]  # fmt: skip
