"""``yawrate excite``."""

from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from tuners.cli.example import example
from tuners.cli.files import READABLE, Output, keep
from tuners.cli.text import every
from yawrate_env.files import write_text
from yawrate_env.vehicle import vehicle_file
from yawrate_env.vehicle.episode import excitation
from yawrate_env.vehicle.task import Task


@click.command(epilog=example("yawrate excite --vehicle car.toml -o prbs.csv"))
@click.option(
    "--vehicle", type=READABLE, help="A vehicle's TOML file, or a plant's. [default: the paper's]"
)
@click.option("-o", "--out", type=Output(), required=True, help="CSV file to write.")
@click.option("--seed", type=click.IntRange(min=0), default=0, help="Of a random register.")
def command(vehicle: Path | None, out: Path, seed: int) -> None:
    """Write the steering signal to drive: time [s] and road-wheel angle [rad].

    For a plant of your own, time [s] and its input, in the plant's unit.
    """
    from yawrate_env.plant.entry import from_toml

    keep(out, vehicle)
    word = np.random.default_rng(seed).integers(0, 2**64, 1, np.uint64)
    plant = None if vehicle is None else from_toml(vehicle)
    if plant is not None:
        _write(out, "u", plant.inputs(word)[0], plant.Ts)
        click.echo(f"{out}: {len(plant.u) * plant.Ts:g} s of {plant.signals[0]}, {every(plant.Ts)}")
        return
    experiment = (Task() if vehicle is None else vehicle_file.read(vehicle)).experiment
    u = excitation(experiment, word)[0]
    _write(out, "steer", u, experiment.Ts)
    click.echo(
        f"{out}: {len(u) * experiment.Ts:g} s of steering, ±{np.degrees(experiment.amplitude):.3g} "
        f"deg at the road wheel, {every(experiment.Ts)}"
    )


def _write(out: Path, name: str, u: NDArray[np.float64], Ts: float) -> None:
    rows = (f"{t:.9g},{a:.9g}" for t, a in zip(Ts * np.arange(len(u)), u, strict=True))
    write_text(out, "\n".join([f"t,{name}", *rows]) + "\n")
