"""``yawrate excite``."""

import csv
import io
from pathlib import Path

import click
import numpy as np

from tuners.cli.arguments import SEED, Output, example, refuse_overwriting, vehicle_option
from tuners.cli.sources import plant_from
from tuners.cli.text import displayed, every, quantity
from yawrate_env.files import write_text
from yawrate_env.plant.names import split


@click.command(epilog=example("yawrate excite --vehicle car.toml -o prbs.csv"))
@vehicle_option
@click.option("-o", "--out", type=Output(), required=True, help="CSV file to write.")
@click.option("--seed", type=SEED, default=0, help="Seed of a random input.")
def command(vehicle: Path | None, out: Path, seed: int) -> None:
    """Write the input signal of the experiment: time [s], and the input in the plant's unit."""
    refuse_overwriting(out, vehicle)
    plant = plant_from(vehicle)
    (u,) = plant.inputs(np.random.default_rng(seed).integers(0, 2**64, 1, np.uint64))
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["t", plant.signals[0]])
    times = plant.Ts * np.arange(len(u))
    writer.writerows((f"{t:.9g}", f"{a:.9g}") for t, a in zip(times, u, strict=True))
    write_text(out, text.getvalue())
    (name, factor), _ = displayed(plant)
    word, unit = split(name)
    low, high = factor * float(u.min()), factor * float(u.max())
    start = "±" if np.isclose(-low, high) else f"{low:.3g} to "
    levels = start + quantity(high, unit, digits=3)
    click.echo(f"{out}: {len(u) * plant.Ts:g} s of {word}, {levels}, {every(plant.Ts)}")
