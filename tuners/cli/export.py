"""``yawrate export``."""

from pathlib import Path
from typing import Any

import click

from tuners.cli import plant
from tuners.cli.example import example
from tuners.cli.files import READABLE, Output, keep
from tuners.cli.numbers import NUMBER, POSITIVE
from tuners.cli.tuner_option import loaded
from tuners.export import TARGETS, Gains, export


@click.command(epilog=example("yawrate export --kp 0.42 --Ti 0.31 --target c --out yaw_pi"))
@click.option("--kp", type=POSITIVE, help="Proportional gain [s].")
@click.option("--Ti", "ti", type=POSITIVE, help="Integral time [s].")
@click.option(
    "--result",
    type=READABLE,
    help="Gains in an answer of `yawrate tune --json`, a vehicle's or a plant's.",
)
@click.option(
    "--tuner",
    metavar="NAME|FILE",
    help="A tuner instead of gains, for onnx and c, from recordings to gains. With Laguerre "
    "features only: a plant's usual one, ts-ff-lag, ts-ff-lag-vx, and for onnx ts-gbm-lag.",
)
@click.option(
    "--features",
    is_flag=True,
    help="Cut a tuner at its features: c ends there, and onnx begins there, for any input.",
)
@click.option(
    "--Ts",
    "ts",
    type=POSITIVE,
    help="Sampling time of the controller [s]. [default: the result's, or 0.01]",
)
@click.option(
    "--limits",
    type=(NUMBER, NUMBER),
    metavar="LOW HIGH",
    help="Least and largest command [rad], or in the plant's unit. [default: 30 deg to both sides; "
    "none for a plant]",
)
@click.option(
    "--target",
    type=click.Choice(TARGETS),
    default="c",
    show_default=True,
    help="C99 source with tests, a MATLAB script, JSON, or an ONNX graph.",
)
@click.option(
    "-o",
    "--out",
    type=Output(folder=True),
    required=True,
    help="File to write; a folder for c.",
)
def command(
    kp: float | None, ti: float | None, result: Path | None, tuner: str | None, features: bool,
    ts: float | None, limits: tuple[float, float] | None, target: str, out: Path,
) -> None:  # fmt: skip
    """Write a controller, or a tuner, for the vehicle's computer, or any plant's.

    A controller in C or MATLAB is a PI: of other gains there is JSON.
    """
    given = (kp, ti) != (None, None), result is not None, tuner is not None
    if tuner is None and target == "onnx":
        raise click.UsageError("Target onnx is for a tuner: give --tuner.")
    if sum(given) > 1:
        raise click.UsageError("Give --kp and --Ti, or a --result, or a --tuner, not both.")
    if not any(given) or (given[0] and None in (kp, ti)):
        raise click.UsageError("Give --kp and --Ti, or a --result, or a --tuner.")
    if features and tuner is None:
        raise click.UsageError("--features is for a tuner: give --tuner.")
    if tuner is not None and (ts, limits) != (None, None):
        raise click.UsageError("--Ts and --limits are a controller's: give gains, not --tuner.")
    if out.exists() and out.is_dir() != (target == "c"):
        raise click.UsageError(f"{out} exists. Target c writes a folder, any other a file.")
    keep(out, tuner, result)
    source: Any = kp, ti
    if result is not None:
        source = Gains.read(result)
    elif tuner is not None:
        source = plant.loaded(tuner) if plant.is_plants(tuner) else loaded(tuner)
    for path in export(source, target, out, Ts=ts, limits=limits, features=features):
        click.echo(str(path))
    if result is not None and not source.trusted:
        click.echo(f"{result} says that these gains are not to be trusted.", err=True)
