"""``yawrate excite``."""

from pathlib import Path

import click
import numpy as np

from tuners import vehicle_file
from tuners.cli.example import example
from tuners.cli.files import READABLE, Output, keep
from yawrate_env.episode import excitation
from yawrate_env.files import write_text
from yawrate_env.task import Task

HEADER = "t,steer"


@click.command(epilog=example("yawrate excite --vehicle car.toml -o prbs.csv"))
@click.option("--vehicle", type=READABLE, help="A vehicle's TOML file. [default: the paper's]")
@click.option("-o", "--out", type=Output(), required=True, help="CSV file to write.")
@click.option("--seed", type=click.IntRange(min=0), default=0, help="Of a random register.")
def command(vehicle: Path | None, out: Path, seed: int) -> None:
    """Write the steering signal to drive: time [s] and road-wheel angle [rad]."""
    keep(out, vehicle)
    task = Task() if vehicle is None else vehicle_file.read(vehicle)
    experiment = task.experiment
    start = np.random.default_rng(seed).integers(0, 2**64, 1, np.uint64)
    u = excitation(experiment, start)[0]
    time = experiment.Ts * np.arange(len(u))
    rows = (f"{t:.9g},{a:.9g}" for t, a in zip(time, u, strict=True))
    write_text(out, "\n".join([HEADER, *rows]) + "\n")
    click.echo(
        f"{out}: {len(u) * experiment.Ts:g} s of steering, ±{np.degrees(experiment.amplitude):.3g} "
        f"deg at the road wheel, a sample every {1e3 * experiment.Ts:g} ms"
    )
