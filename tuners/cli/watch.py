"""``yawrate watch``."""

import json
from dataclasses import asdict
from pathlib import Path

import click

from tuners.cli.answer import plain
from tuners.cli.arguments import POSITIVE, example, vehicle_option
from tuners.cli.drives import drives_of, task_of, whole
from tuners.cli.log_files import LOGS, log_files
from tuners.cli.log_options import log_options
from tuners.cli.text import VERDICTS
from tuners.logs import LogError, Options, SelectionError, read_log
from tuners.recalibration.watch import GAP, Advice, Watch
from tuners.trust.intervals import GAUSSIAN
from yawrate_env.vehicle.yaw_rate import yaw_rate


@click.command(epilog=example("yawrate watch drives/ --kp 0.12 --Ti 0.21"))
@click.argument("logs", nargs=-1, required=True, type=LOGS)
@log_options
@vehicle_option
@click.option("--kp", type=POSITIVE, help="kp in effect. [default: what the first log asks for]")
@click.option("--Ti", "Ti", type=POSITIVE, help="Ti in effect [s].")
@click.option("--gap", type=POSITIVE, default=GAP / 60, show_default=True,
              help="Time between two logs [min]: friction moves in it.")  # fmt: skip
@click.option("--same-load", is_flag=True, help="The load does not change between logs.")
@click.option("--json", "machine", is_flag=True, help="Print one JSON object a log, a line each.")
def command(
    logs: tuple[Path, ...],
    options: Options,
    vehicle: Path | None,
    kp: float | None,
    Ti: float | None,
    gap: float,
    same_load: bool,
    machine: bool,
) -> None:
    """Follow one car through its LOGS, files or folders of them, in time order.

    Logs may be of open or closed loops; of a folder the files are taken in the order of their
    names.  Friction and load are followed by a filter from log to log.  A line a log says what they
    are, whether the gains in effect should change, to what, and when the car left what is known.
    It has a verdict on the gains of the design rule, with half widths of 90 % intervals of their
    phase margin and crossover that need no exact vehicle data.  Gains that should change count as
    changed from the next log on.
    """
    if (kp is None) != (Ti is None):
        raise click.UsageError("--kp and --Ti belong together: give both.")
    task = task_of(vehicle)
    watch = Watch(drives_of(task), None if kp is None or Ti is None else (kp, Ti))
    plant, options = yaw_rate(task, check=False), whole(options)
    for path in log_files(logs):
        try:
            log = read_log(path, plant, options)
        except SelectionError as error:
            raise click.UsageError(str(error)) from None
        except LogError as error:
            click.echo(_refused(path, error, machine))
            continue
        speed = log.measured["v_x"]
        advice = watch.add(log.u, log.y, log.Ts, speed, gap=60 * gap, loaded=not same_load)
        click.echo(_json(path, advice) if machine else _line(path, advice))
        if advice.change:
            watch.gains = advice.kp, advice.Ti


def _line(path: Path, advice: Advice) -> str:
    (mu_s, doubt), (load, more) = advice.mu_s, advice.M_delta
    parts = [
        f"{path.name}: friction {mu_s:.2f} ± {GAUSSIAN * doubt:.2f}, "
        f"load {load:.0f} ± {GAUSSIAN * more:.0f} kg, {advice.v_x:.1f} m/s",
        f"phase margin {advice.phase_margin[0]:.1f} deg, crossover {advice.crossover[0]:.2f} Hz",
    ]
    if advice.jumped:
        parts.append("friction jumped")
    if advice.change:
        parts.append(f"CHANGE gains to kp = {advice.kp:.4g}, Ti = {advice.Ti:.4g} s")
    else:
        parts.append("keep gains")
    margin, crossover = advice.half_widths
    verdict = VERDICTS[advice.verdict].lower()
    parts.append(f"gains of the rule {verdict}: ± {margin:.1f} deg, ± {crossover:.2f} Hz")
    if advice.left:
        parts.append(f"LEFT WHAT IS KNOWN: {advice.left}; tune again from a recording")
    return "; ".join(parts)


def _json(path: Path, advice: Advice) -> str:
    return json.dumps({"log": path.name, **plain(asdict(advice))}, allow_nan=False)


def _refused(path: Path, error: Exception, machine: bool) -> str:
    said = " ".join(str(error).split())
    return (
        json.dumps({"log": path.name, "error": said})
        if machine
        else f"{path.name}: unusable: {said}"
    )
