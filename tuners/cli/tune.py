"""``yawrate tune``."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import click

from tuners.cli import answer, plant
from tuners.cli.example import example
from tuners.cli.files import READABLE, Output, keep
from tuners.cli.grouped import PLANT, VEHICLE, Grouped, refuse_others
from tuners.cli.hints import Array, Trial, hints
from tuners.cli.log_options import log_options
from tuners.cli.tuner_option import loaded
from tuners.logs import Options, SelectionError, read_log
from tuners.logs.plant_log import PlantOptions
from tuners.trust.black_box import STARTS
from tuners.tuner.result import TuningResult

DEFAULT = "ts-ff-lag-vx"
UNTRUSTED = 3

STEP, LATEST = 0.01, 0.3
"""How much earlier a yaw rate is tried [s]."""


@click.command(
    cls=Grouped, epilog=example("yawrate tune log.csv --steer-unit deg --report report.html")
)
@click.argument("log", type=READABLE)
@log_options
@click.option(
    "--start",
    "begin",
    type=click.Choice(STARTS),
    default="auto",
    show_default=True,
    help="Whether the recording starts from rest without offsets, or these are estimated; "
    "auto looks.",
)
@click.option(
    "--tuner",
    default=DEFAULT,
    show_default=True,
    metavar="NAME|FILE",
    help="A tuner that the package ships, or a file of `yawrate train`.",
)
@click.option("--report", type=Output(".html"), help="Write a report to this HTML file.")
@click.option("--json", "machine", is_flag=True, help="Print one JSON object.")
def command(
    log: Path, vehicle: Options, own: PlantOptions, begin: str, tuner: str,
    report: Path | None, machine: bool,
) -> None:  # fmt: skip
    """Tune a PI controller from a LOG of steering and yaw rate.

    LOG is CSV, MATLAB (any version), Parquet or MDF4.  Columns called t, steer, yaw_rate
    and speed, or much like it, are found without flags.  Of a long log the best-excited
    stretch is used.

    With the tuner of a plant of your own the columns are t, u and y, or what the plant
    calls its signals and measured parameters.

    Exit status: 0 trusted, 3 not trusted, 1 unusable data, 2 wrong usage.
    """
    keep(report, log, tuner)
    is_plants = plant.is_plants(tuner)
    refuse_others(PLANT if is_plants else VEHICLE, tuner)
    try:
        if is_plants:
            trusted = plant.tune(tuner, log, own, begin, machine, report)
        else:
            trusted = tune(tuner, log, vehicle, begin, machine, report)
    except SelectionError as error:
        raise click.UsageError(str(error)) from None
    sys.exit(0 if trusted else UNTRUSTED)


def tune(
    tuner: str, log: Path, options: Options, start: str, machine: bool, report: Path | None
) -> bool:
    """Print the gains for a vehicle's log; returns whether they are trusted."""
    trained = loaded(tuner)
    recording = read_log(log, trained.task, options)
    Ts, remedy = recording.Ts, "leave out" if options.steer_sign < 0 else "try"

    def answer_to(steer: Array, yaw_rate: Array) -> TuningResult:
        speed = recording.speed[-len(yaw_rate) :]
        return trained.tune(steer, yaw_rate, Ts, speed, start)

    result = answer_to(recording.steer, recording.yaw_rate)
    found = hints(
        Trial(answer_to, recording.steer, recording.yaw_rate),
        result,
        step=round(STEP / Ts),
        latest=int(LATEST / Ts + 1e-9),
        sign=f"With the steering's sign reversed a vehicle fits: {remedy} --flip-steer.",
        late=lambda samples: (
            f"The yaw rate seems to be logged {1e3 * samples * Ts:.0f} ms late: earlier, a "
            "vehicle fits."
        ),
    )
    result = replace(result, notes=(*result.notes, *found))
    if machine:
        click.echo(json.dumps(answer.as_json(result, recording, trained.task, tuner), indent=1))
    else:
        click.echo(answer.as_text(result, recording, trained.task))
    if report is not None:
        from tuners.cli.report import write_report

        write_report(report, result, recording, trained.task, tuner)
    return result.trusted
