"""``yawrate tune``."""

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import click

from tuners.cli.arguments import (
    READABLE,
    REFUSED,
    Output,
    example,
    refuse_overwriting,
)
from tuners.cli.log_files import LOGS, log_files, read_each, recordings
from tuners.cli.log_options import log_options
from tuners.cli.target_options import Changes, target_options
from tuners.cli.tuning import (
    FITTED,
    for_loop,
    loading,
    pooled,
    several_logs,
    start_option,
    tuned,
    tuner_and_log,
    tuner_option,
)
from tuners.logs import Log, Options, SelectionError
from tuners.trust.verdict import Verdict
from tuners.tuner.result import Result
from tuners.tuner.tuner import Tuner

TABLES = ".csv", ".parquet"


@click.command(epilog=example("yawrate tune log.csv --input-unit deg --report report.html"))
@click.argument("logs", type=LOGS, nargs=-1, required=True, metavar="LOG...")
@log_options
@start_option
@tuner_option
@click.option(
    "--plant",
    "--vehicle",
    "plant",
    type=READABLE,
    help="A plant instead of a trained tuner, TOML or Python: its simulator is fitted to the log "
    f"(--tuner {FITTED}), or what --tuner names.",
)
@click.option(
    "--validate",
    type=READABLE,
    help="A further log, which the gains do not come from: how well the tuned plant reproduces "
    "it, and whether its own answer agrees.",
)
@click.option("--each", is_flag=True, help="Tune every log by itself: a table, one row a log.")
@click.option("--out", type=Output(), help="File for the table of --each: *.csv or *.parquet.")
@target_options
@click.option("--speeds", is_flag=True, help="Slower and faster loops, too, with their margins.")
@click.option("--report", type=Output(".html"), help="Write a report to this HTML file.")
@click.option("--strict", is_flag=True, help="Exit with 3 also where gains need care.")
@click.option("--json", "machine", is_flag=True, help="Print one JSON object.")
def command(
    logs: tuple[Path, ...],
    options: Options,
    start: str,
    tuner: str | None,
    plant: Path | None,
    validate: Path | None,
    each: bool,
    out: Path | None,
    target: Changes,
    speeds: bool,
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

    Several LOGs, or a folder of them, are of one plant: their information adds up, and a log
    that disagrees with the others is named.  The gains are for the speed that they have in
    common; where they have none, --speed or --measured says which, and `yawrate schedule`
    makes a table over all of them.

    Exit status: 0 usable, with care or without, 3 refused or contradicted by --validate,
    1 unusable data, 2 wrong usage.  Of --each: 0 all usable, 3 some refused, 1 some unusable.
    """
    files = log_files(logs)
    _check(files, validate, each, out, report, machine, speeds)
    for path in files:
        refuse_overwriting(report, path, tuner)
        refuse_overwriting(out, path, tuner)
    refuse_overwriting(report, validate)
    tuner, load = tuner or (None if plant is None else FITTED), loading(plant)
    try:
        if each:
            from tuners.cli.each import tune_each

            sys.exit(tune_each(files, options, start, tuner, out, strict, load))
        tuner, result, read = _answer(files, options, start, tuner, validate, target, load)
    except SelectionError as error:
        raise click.UsageError(str(error)) from None
    from tuners.cli.answer import as_json
    from tuners.cli.speeds import speeds as loops_of
    from tuners.cli.speeds import speeds_json, speeds_text
    from tuners.cli.text import as_text

    paced = loops_of(result) if speeds else {}
    if machine:
        answer = as_json(result, read[0], tuner, read if len(files) > 1 else ())
        answer |= {"speeds": speeds_json(paced)} if speeds else {}
        click.echo(json.dumps(answer, indent=1, allow_nan=False))
    else:
        click.echo(as_text(result, read[0], read if len(files) > 1 else ()))
        if speeds:
            click.echo("\n" + speeds_text(result, paced))
    if report is not None:
        from tuners.cli.report import write_report

        write_report(report, result, read[0], tuner, read if len(files) > 1 else ())
    enough = result.verdict is Verdict.USABLE if strict else result.trusted
    if result.validation is not None:
        enough = enough and not result.validation.contradicts
    sys.exit(0 if enough else REFUSED)


def _check(
    files: Sequence[Path],
    validate: Path | None,
    each: bool,
    out: Path | None,
    report: Path | None,
    machine: bool,
    speeds: bool,
) -> None:
    """Refuse options that contradict each other."""
    if validate is not None and any(validate.samefile(path) for path in files):
        raise click.UsageError(
            f"--validate {validate} is tuned from, too: it would agree with itself. Name another."
        )
    if not each:
        if out is not None:
            raise click.UsageError("--out is for the table of --each: give that too.")
        return
    given = {"--validate": validate, "--report": report, "--json": machine or None,
             "--speeds": speeds or None}  # fmt: skip
    for name, value in given.items():
        if value is not None:
            raise click.UsageError(f"--each and {name} contradict each other: leave out one.")
    if out is not None and out.suffix not in TABLES:
        raise click.UsageError(f"--out {out} must end in {' or '.join(TABLES)}.")


def _answer(
    files: Sequence[Path],
    options: Options,
    start: str,
    name: str | None,
    validate: Path | None,
    changes: Changes,
    load: Callable[[str], Tuner],
) -> tuple[str, Result, list[Log]]:
    """The tuner's name, its result, and the logs that it comes from."""
    if len(files) == 1:
        name, trained, log = tuner_and_log(files[0], options, name, load)
        further = [] if validate is None else read_each([validate], trained.plant, options)
        read = [log, *further]
    else:
        paths = [*files, *([] if validate is None else [validate])]
        name, trained, read = several_logs(paths, options, name, load)

    def answered(tuner: Tuner) -> Result:
        if len(files) > 1:
            return pooled(tuner, read, options, start, validate is not None)
        result = tuned(tuner, read[0], start, options.input_scale)
        if validate is None:
            return result
        own, other = recordings(tuner.plant, read)
        held = tuner.pool([own], names=[log.source for log in read], validate=other, start=start)
        return replace(result, validation=held.validation)

    return name, for_loop(trained, changes, answered), read[: len(files)]
