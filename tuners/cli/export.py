"""``yawrate export``."""

from pathlib import Path

import click

from tuners.cli.example import example
from tuners.cli.files import Output
from tuners.cli.log_options import POSITIVE
from tuners.cli.tuner_option import loaded

TARGETS = ("c", "matlab", "json", "onnx")


@click.command(epilog=example("yawrate export --kp 0.42 --Ti 0.31 --target c -o yaw_pi.c"))
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
@click.option("--tuner", metavar="NAME|FILE", help="A tuner, for onnx.")
@click.option(
    "--target",
    type=click.Choice(TARGETS),
    default="c",
    show_default=True,
    help="What to write: a controller as source or data, or a tuner as a network.",
)
@click.option("-o", "--out", type=Output(), required=True, help="File to write.")
def command(
    kp: float | None, ti: float | None, ts: float, tuner: str | None, target: str, out: Path
) -> None:  # fmt: skip
    """Write a controller, or a tuner, for the vehicle's computer."""
    from tuners.export import export

    if target == "onnx":
        if tuner is None:
            raise click.UsageError("onnx exports a tuner: give --tuner.")
        export(loaded(tuner), target, out)
    else:
        if kp is None or ti is None:
            raise click.UsageError(f"{target} exports a controller: give --kp and --Ti.")
        export((kp, ti), target, out, Ts=ts)
    click.echo(str(out))
