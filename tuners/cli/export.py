"""``yawrate export``."""

from pathlib import Path
from typing import Any

import click

from tuners.cli.arguments import (
    NUMBER,
    POSITIVE,
    READABLE,
    Output,
    example,
    refuse_overwriting,
    vehicle_option,
)
from tuners.cli.sources import load_tuner, plant_from
from tuners.export import TARGETS, Gains, export


@click.command(epilog=example("yawrate export --kp 0.42 --Ti 0.31 --target c --out yaw_pi"))
@click.option("--kp", type=POSITIVE, help="Proportional gain.")
@click.option("--Ti", "ti", type=POSITIVE, help="Integral time [s].")
@vehicle_option
@click.option("--result", type=READABLE, help="Take the gains from `yawrate tune --json`.")
@click.option(
    "--tuner",
    metavar="NAME|FILE",
    help="A tuner instead of gains, for targets onnx and c, from recordings to gains; with "
    "Laguerre features only, as trained by default, ts-ff-lag, ts-ff-lag-vx, and for onnx "
    "ts-gbm-lag.",
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
    help="Sampling time of the controller [s]. [default: the plant's or the result's]",
)
@click.option(
    "--limits",
    type=(NUMBER, NUMBER),
    multiple=True,
    metavar="LOW HIGH",
    help="Least and largest command, in the plant's unit; of several loops once for each, in the "
    "order of the inputs. [default: the plant's, if any]",
)
@click.option(
    "--target",
    type=click.Choice(TARGETS),
    default="c",
    show_default=True,
    help="C99 source with tests, a MATLAB script, a function block in IEC 61131-3 structured "
    "text, JSON, or an ONNX graph.",
)
@click.option(
    "-o",
    "--out",
    type=Output(folder=True),
    required=True,
    help="File to write; a folder for c.",
)
def command(
    kp: float | None, ti: float | None, vehicle: Path | None, result: Path | None,
    tuner: str | None, features: bool, ts: float | None, limits: tuple[tuple[float, float], ...],
    target: str, out: Path,
) -> None:  # fmt: skip
    """Write a controller, or a tuner, for another program.

    Controllers from P to 2DOF, lead-lag and state feedbacks go to c, matlab, st and json, other
    gains to json.  Gains --kp and --Ti are those of --vehicle.
    """
    given = (kp, ti) != (None, None), result is not None, tuner is not None
    if tuner is None and target == "onnx":
        raise click.UsageError("Target onnx is for a tuner: give --tuner.")
    if sum(given) > 1:
        raise click.UsageError("Give --kp and --Ti, or a --result, or a --tuner, not both.")
    if not any(given) or (given[0] and None in (kp, ti)):
        raise click.UsageError("Give --kp and --Ti, or a --result, or a --tuner.")
    if vehicle is not None and not given[0]:
        raise click.UsageError("--vehicle is for --kp and --Ti: leave it out.")
    if features and tuner is None:
        raise click.UsageError("--features is for a tuner: give --tuner.")
    if tuner is not None and (ts, limits) != (None, ()):
        raise click.UsageError("--Ts and --limits are a controller's: give gains, not --tuner.")
    if out.exists() and out.is_dir() != (target == "c"):
        raise click.UsageError(f"{out} exists. Target c writes a folder, any other a file.")
    refuse_overwriting(out, tuner, result, vehicle)
    source: Any
    if tuner is not None:
        source = load_tuner(tuner)
    elif result is not None:
        source = Gains.read(result)
    else:
        source = Gains.of((kp, ti), plant_from(vehicle))
    chosen = limits[0] if len(limits) == 1 else limits or None
    for path in export(source, target, out, Ts=ts, limits=chosen, features=features):
        click.echo(str(path))
    if result is not None and not source.trusted:
        click.echo(f"{result}: these gains are refused.", err=True)
