"""``yawrate tune``."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import click

from tuners.cli.arguments import READABLE, Output, example, refuse_overwriting
from tuners.cli.log_options import log_options
from tuners.cli.sources import load_tuner
from tuners.logs import Log, MissingParameterError, Options, SelectionError, log_of, read_table
from tuners.trust.black_box import STARTS
from tuners.trust.verdict import Verdict
from tuners.tuner.result import Result
from tuners.tuner.tuner import Tuner

DEFAULT = "ts-ff-lag-vx"
WITHOUT = "bb"
"""What tunes by default, and what does without a measured parameter."""

REFUSED = 3


@click.command(epilog=example("yawrate tune log.csv --input-unit deg --report report.html"))
@click.argument("log", type=READABLE)
@log_options
@click.option(
    "--start",
    type=click.Choice(STARTS),
    default="auto",
    show_default=True,
    help="Whether the recording starts from rest without offsets, at an operating point (offset), "
    "or anyhow; auto decides by the data.",
)
@click.option(
    "--tuner",
    metavar="NAME|FILE",
    help="A tuner that the package ships, or a file of `yawrate train`; by default "
    f"{DEFAULT}, or {WITHOUT} where the log gives no speed.",
)
@click.option("--report", type=Output(".html"), help="Write a report to this HTML file.")
@click.option("--strict", is_flag=True, help="Exit with 3 also where gains need care.")
@click.option("--json", "machine", is_flag=True, help="Print one JSON object.")
def command(
    log: Path,
    options: Options,
    start: str,
    tuner: str | None,
    report: Path | None,
    strict: bool,
    machine: bool,
) -> None:
    """Tune a controller from a LOG of a plant's input and output.

    LOG is text of any layout, a spreadsheet, MATLAB, HDF5, Parquet, Feather, MDF, MCAP (ROS 2)
    or a CAN trace with --dbc; compressed or not; /dev/stdin is a pipe.  Columns called t and as
    the tuner's plant calls its signals and measured parameters (u and y; for a vehicle steer,
    yaw_rate and speed), or as loggers call these, need no flags.  Of a long log the best-excited
    stretch at a steady speed is used.

    Exit status: 0 usable, with care or without, 3 refused, 1 unusable data, 2 wrong usage.
    """
    refuse_overwriting(report, log, tuner)
    try:
        tuner, trained, recording = _read(log, options, tuner)
    except SelectionError as error:
        raise click.UsageError(str(error)) from None
    try:
        result = tuned(trained, recording, start, options.input_scale)
    except ValueError as error:
        raise ValueError(f"{log}: {error}") from None
    from tuners.cli.answer import as_json
    from tuners.cli.text import as_text

    if machine:
        click.echo(json.dumps(as_json(result, recording, tuner), indent=1, allow_nan=False))
    else:
        click.echo(as_text(result, recording))
    if report is not None:
        from tuners.cli.report import write_report

        write_report(report, result, recording, tuner)
    enough = result.verdict is Verdict.USABLE if strict else result.trusted
    sys.exit(0 if enough else REFUSED)


def _read(log: Path, options: Options, name: str | None) -> tuple[str, Tuner, Log]:
    """The tuner's name, the tuner and the log; by default the one that the log suffices for."""
    chosen = name or DEFAULT
    trained = load_tuner(chosen)
    table = read_table(log, options.dbc)
    try:
        return chosen, trained, log_of(table, trained.plant, options)
    except MissingParameterError:
        if name is not None:
            raise
    trained = load_tuner(WITHOUT)
    return WITHOUT, trained, log_of(table, trained.plant, options)


def tuned(tuner: Tuner, log: Log, start: str, input_scale: float) -> Result:
    """The result for a log, its notes and hints included."""
    from tuners.cli.hints import Array, hints

    def tune(u: Array, y: Array, measured: dict[str, Array]) -> Result:
        return tuner.tune(u, y, log.Ts, measured, start)

    result = tune(log.u, log.y, log.measured)
    notes = (*log.notes, *result.notes, *hints(tune, log, result, input_scale))
    return replace(result, notes=notes)
