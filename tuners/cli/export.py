"""``yawrate export``."""

from pathlib import Path

import click

from tuners.cli.example import example
from tuners.cli.files import Output, keep
from tuners.cli.numbers import NUMBER, POSITIVE
from tuners.cli.tuner_option import loaded

TARGETS = ("c", "matlab", "json", "onnx")


@click.command(epilog=example("yawrate export --kp 0.42 --Ti 0.31 --target c --out yaw_pi"))
@click.option("--kp", type=POSITIVE, help="Proportional gain [s].")
@click.option("--Ti", "ti", type=POSITIVE, help="Integral time [s].")
@click.option(
    "--Ts",
    "ts",
    type=POSITIVE,
    default=0.01,
    show_default=True,
    help="Sampling time of the controller [s].",
)
@click.option(
    "--limits",
    type=(NUMBER, NUMBER),
    metavar="LOW HIGH",
    help="Least and largest command [rad]. [default: 30 deg to both sides]",
)
@click.option(
    "--tuner",
    metavar="NAME|FILE",
    help="A tuner instead of gains, for onnx (all of it) and c (its first stage: features). "
    "With Laguerre features only: ts-ff-lag, ts-gbm-lag.",
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
    kp: float | None, ti: float | None, ts: float, limits: tuple[float, float] | None,
    tuner: str | None, target: str, out: Path,
) -> None:  # fmt: skip
    """Write a controller, or a tuner, for the vehicle's computer."""
    from tuners.export import export
    from tuners.export.digital_pi import LIMITS

    if tuner is None and target == "onnx":
        raise click.UsageError("Target onnx is for a tuner: give --tuner.")
    if tuner is None and (kp is None or ti is None):
        raise click.UsageError("Give --kp and --Ti, or a --tuner.")
    if tuner is not None and (kp, ti) != (None, None):
        raise click.UsageError("Give --kp and --Ti, or a --tuner, not both.")
    if out.exists() and out.is_dir() != (target == "c"):
        raise click.UsageError(f"{out} exists. Target c writes a folder, any other a file.")
    keep(out, tuner)
    source = (kp, ti) if tuner is None else loaded(tuner)
    for path in export(source, target, out, Ts=ts, limits=limits or LIMITS):
        click.echo(str(path))
