"""``yawrate tune``."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from tuners.cli.arguments import NONZERO, POSITIVE, READABLE, Output, example, refuse_overwriting
from tuners.cli.log_options import log_options
from tuners.cli.sources import load_tuner
from tuners.logs import Log, MissingParameterError, Options, SelectionError, read_log
from tuners.trust.black_box import STARTS
from tuners.trust.feedback import rebuilt
from tuners.trust.verdict import Verdict
from tuners.tuner.result import Result
from tuners.tuner.tuner import Tuner
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

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
    "--old-kp",
    type=NONZERO,
    help="kp of the PI that drove, where the log was recorded in a closed loop and has no "
    "reference: that is then rebuilt.  In the plant's units, as kp in the answer.",
)
@click.option("--old-Ti", "old_Ti", type=POSITIVE, help="Ti of that PI [s].")
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
    old_kp: float | None,
    old_Ti: float | None,
    tuner: str | None,
    report: Path | None,
    strict: bool,
    machine: bool,
) -> None:
    """Tune a controller from a LOG of a plant's input and output.

    LOG is CSV, MATLAB (any version), Parquet or MDF4.  Columns called t and as the tuner's
    plant calls its signals and measured parameters (u and y; for a vehicle steer, yaw_rate
    and speed), or similarly, need no flags.  Of a long log the best-excited stretch is used.

    Exit status: 0 usable, with care or without, 3 refused, 1 unusable data, 2 wrong usage.
    """
    refuse_overwriting(report, log, tuner)
    drove = _drove(old_kp, old_Ti, options)
    try:
        tuner, trained, recording = _read(log, options, tuner)
    except SelectionError as error:
        raise click.UsageError(str(error)) from None
    if drove is not None:
        recording = replace(recording, reference=_rebuilt(recording, trained.plant, drove))
    result = tuned(trained, recording, start, options.input_scale)
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
    try:
        return chosen, trained, read_log(log, trained.plant, options)
    except MissingParameterError:
        if name is not None:
            raise
    trained = load_tuner(WITHOUT)
    return WITHOUT, trained, read_log(log, trained.plant, options)


def _drove(kp: float | None, Ti: float | None, options: Options) -> tuple[float, float] | None:
    """Gains of the controller that drove, if they are given."""
    if kp is None and Ti is None:
        return None
    if kp is None or Ti is None:
        raise click.UsageError("--old-kp and --old-Ti belong together: give both.")
    if "reference" in options.columns:
        raise click.UsageError(
            f"--reference {options.columns['reference']} and --old-kp contradict each other: the "
            "reference need not be rebuilt. Leave out one of the two."
        )
    if options.input_is != "command":
        raise click.UsageError(
            "--old-kp and --input-is measured contradict each other: the reference is rebuilt from "
            "the command. Name its column with --input-column."
        )
    return kp, Ti


def _rebuilt(log: Log, plant: Plant, gains: tuple[float, float]) -> Array:
    """The reference of a log, from the gains of the controller that drove."""
    target = plant.parametrisation.target
    if target is None:
        raise click.UsageError("--old-kp: this tuner's plant has no PI. Give --reference COLUMN.")
    return rebuilt(log.u, log.y, log.Ts, gains, target)


def tuned(tuner: Tuner, log: Log, start: str, input_scale: float) -> Result:
    """The result for a log, its notes and hints included."""
    from tuners.cli.hints import hints

    def tune(u: Array, y: Array, measured: dict[str, Array]) -> Result:
        return tuner.tune(u, y, log.Ts, measured, start)

    if log.reference is None:
        result = tune(log.u, log.y, log.measured)
        advice = hints(tune, log, result, input_scale)
    else:
        result = tuner.tune(log.u, log.y, log.Ts, log.measured, start, log.reference)
        advice = ()
    notes = (*log.notes, *result.notes, *advice)
    return replace(result, notes=notes)
