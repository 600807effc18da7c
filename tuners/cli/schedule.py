"""``yawrate schedule``."""

import sys
from pathlib import Path

import click

from tuners.cli.arguments import NUMBER, REFUSED, Output, example, refuse_overwriting
from tuners.cli.log_files import LOGS, log_files, recordings, wanted
from tuners.cli.log_options import log_options
from tuners.cli.tuning import several_logs, start_option, tuner_option
from tuners.logs import Options, SelectionError

ENDINGS = ".csv", ".json", ".png", ".svg", ".pdf"
_MOST = 1000


class Grid(click.ParamType):  # type: ignore[type-arg]
    """Values from one number to another in steps: ``10:30:2.5``."""

    name = "low:high:step"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """The values, both ends among them where the step leads there."""
        parts = str(value).split(":")
        if len(parts) != 3:
            self.fail(f"{value} is not of the form LOW:HIGH:STEP.", param, ctx)
        low, high, step = (NUMBER.convert(part, param, ctx) for part in parts)
        if not (step > 0 and high > low):
            self.fail(f"{value} must have LOW below HIGH and STEP above 0.", param, ctx)
        count = int((high - low) / step + 1e-9) + 1
        if count > _MOST:
            self.fail(f"{value} has {count} values, at most {_MOST}.", param, ctx)
        return tuple(low + k * step for k in range(count))


@click.command(epilog=example("yawrate schedule logs/ --grid 10:30:2.5 -o gains.csv --c gains"))
@click.argument("logs", type=LOGS, nargs=-1, required=True, metavar="LOG...")
@log_options
@start_option
@tuner_option
@click.option(
    "--grid", type=Grid(), help="Speeds of the table; nine from the slowest log to the fastest."
)
@click.option("--over", metavar="NAME", help="Measured parameter, where the plant has several.")
@click.option(
    "-o",
    "--out",
    type=Output(),
    multiple=True,
    help="File to write: a table (*.csv), numbers for programs (*.json), or a plot (*.png, *.svg, "
    "*.pdf); can be repeated.",
)
@click.option(
    "--c", "program", type=Output(folder=True), help="Folder for a C99 table with interpolation."
)
@click.option("--json", "machine", is_flag=True, help="Print one JSON object.")
def command(
    logs: tuple[Path, ...],
    options: Options,
    start: str,
    tuner: str | None,
    grid: tuple[float, ...] | None,
    over: str | None,
    out: tuple[Path, ...],
    program: Path | None,
    machine: bool,
) -> None:
    """Make a table of gains over speed from LOGs of one plant.

    LOG is a log as `yawrate tune` takes it, or a folder of them, driven at several speeds.
    The plant is fitted to all of them together, and its gains at each speed of the grid are
    given with 90 % intervals.  Where the logs contradict such a plant, the table holds the gains
    of each log at its own speed.  For plants other than a vehicle, speed stands for the
    parameter that is measured with every recording.

    Exit status: 0 all usable, with care or without, 3 some refused, 1 unusable data, 2 wrong
    usage.
    """
    files = log_files(logs)
    for path in out:
        if path.suffix not in ENDINGS:
            raise click.UsageError(f"--out {path} must end in one of {', '.join(ENDINGS)}.")
        for source in (*files, tuner):
            refuse_overwriting(path, source)
    try:
        name, trained, read = several_logs(files, options, tuner)
        if wanted(trained.plant, options):
            raise click.UsageError("A schedule is over all speeds: leave out --speed and numbers "
                                   "of --measured.")  # fmt: skip
        from tuners.tuner.schedule import schedule

        found = schedule(
            trained, recordings(trained.plant, read), grid, parameter=over,
            names=[log.source for log in read], start=start,
        )  # fmt: skip
    except SelectionError as error:
        raise click.UsageError(str(error)) from None
    from tuners.cli import schedule_text as texts

    for path in out:
        texts.write(path, found, read, name)
    if program is not None:
        from tuners.export import write_schedule

        write_schedule(found, program)
        if not found.trusted:
            click.echo(f"{program}: some of these gains are refused.", err=True)
    click.echo(texts.as_json(found, read, name) if machine else texts.as_text(found, read))
    sys.exit(0 if found.trusted else REFUSED)
