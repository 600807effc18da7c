"""Plants and tuners that commands are given as files or names."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from yawrate_env.plant.plant import Plant

if TYPE_CHECKING:
    from tuners import Tuner


def plant_from(file: Path | None) -> Plant:
    """The plant of a TOML file: a vehicle's values or ``[plant] entry``; None is the paper's.

    Of a Python file it is what is called ``plant`` there.
    """
    from yawrate_env.plant.entry import from_file
    from yawrate_env.vehicle import vehicle_file
    from yawrate_env.vehicle.task import Task
    from yawrate_env.vehicle.yaw_rate import yaw_rate

    if file is None:
        return yaw_rate(Task())
    return from_file(file) or yaw_rate(vehicle_file.read(file))


def load_tuner(name: str, plant: Plant | None = None) -> "Tuner":
    """Load a tuner by name or from a file, for a plant; a missing one is wrong usage."""
    import tuners
    from tuners.catalogue import UNTRAINED
    from tuners.tuner.tuner_file import SUFFIX

    if name.endswith(SUFFIX):
        if not Path(name).is_file():
            raise click.UsageError(f"No tuner file {name}. Make one with `yawrate train`.")
    elif name not in tuners.NAMES:
        raise click.UsageError(
            f"No tuner {name!r}. Give a *{SUFFIX} file, or one of {', '.join(tuners.NAMES)}."
        )
    elif plant is not None and name not in UNTRAINED:
        raise click.UsageError(
            f"--tuner {name} was trained for other plants than --plant: leave that out, or choose "
            f"one of {', '.join(UNTRAINED)}."
        )
    return tuners.load(name, plant)
