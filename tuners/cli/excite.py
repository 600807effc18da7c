"""``yawrate excite``."""

import csv
import io
from pathlib import Path

import click
import numpy as np

from tuners.cli.arguments import (
    NUMBER,
    POSITIVE,
    SEED,
    Output,
    example,
    refuse_overwriting,
    vehicle_option,
)
from tuners.cli.sources import plant_from
from tuners.cli.text import amplitudes, every
from yawrate_env.files import write_text


@click.command(epilog=example("yawrate excite --vehicle car.toml --wanted 0.5 -o prbs.csv"))
@vehicle_option
@click.option("-o", "--out", type=Output(), required=True, help="CSV file to write.")
@click.option("--seed", type=SEED, default=0, help="Seed of a random input.")
@click.option(
    "--wanted",
    type=POSITIVE,
    help="Half width of the 90 % interval that recordings should give: degrees of phase margin, "
    "or the first metric's unit. Chooses length and amplitude.",
)
@click.option(
    "--change",
    type=click.Choice(["both", "length", "amplitude"]),
    help="What --wanted may change. [default: both]",
)
@click.option(
    "--noise",
    type=POSITIVE,
    help="Standard deviation of the sensor's noise, in the output's unit, for --wanted. "
    "[default: the plant's at its experiment]",
)
@click.option(
    "--snr", type=NUMBER, help="The noise by the signal-to-noise ratio of the experiment [dB]."
)
def command(
    vehicle: Path | None,
    out: Path,
    seed: int,
    wanted: float | None,
    change: str | None,
    noise: float | None,
    snr: float | None,
) -> None:
    """Write the input signal of the experiment: time [s], and the input in the plant's unit.

    With --wanted the experiment is made stronger and longer, or weaker and shorter, until the
    intervals that a recording alone supports are as wanted for nine out of ten plants of the
    prior. Simulated recordings with the same noise say so. Where no recording alone tells the
    metric, the intervals are those of the Cramér-Rao bound.
    """
    refuse_overwriting(out, vehicle)
    given = {"change": change, "noise": noise, "snr": snr}
    unused = next((name for name, value in given.items() if value is not None), None)
    if wanted is None and unused is not None:
        raise click.UsageError(f"--{unused} says how to reach --wanted: give that too.")
    if noise is not None and snr is not None:
        raise click.UsageError("--noise and --snr both say how large the noise is: give one.")
    plant, said = plant_from(vehicle), ""
    if wanted is None:
        (u,) = plant.inputs(np.random.default_rng(seed).integers(0, 2**64, 1, np.uint64))
    else:
        from tuners.cli.proposal import proposed

        u, said = proposed(plant, wanted, change or "both", noise, snr, seed)
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["t", *plant.inputs_named])
    rows, times = np.atleast_2d(u), plant.Ts * np.arange(u.shape[-1])
    writer.writerows([f"{value:.9g}" for value in row] for row in zip(times, *rows, strict=True))
    write_text(out, text.getvalue())
    length, inputs = f"{u.shape[-1] * plant.Ts:.6g} s", ", ".join(amplitudes(plant, u))
    click.echo(f"{out}: {length} of {inputs}, {every(plant.Ts)}{said}")
