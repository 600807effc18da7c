"""``yawrate check``."""

import json
import math
import sys
from dataclasses import asdict
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from tuners.catalogue import load
from tuners.cli.arguments import NONZERO, NUMBER, POSITIVE, READABLE, example, vehicle_option
from tuners.cli.drives import drives_of, task_of, whole
from tuners.cli.log_files import recordings
from tuners.cli.log_options import log_options
from tuners.logs import Log, Options, SelectionError, read_log
from tuners.recalibration.achieved import Achieved, Agreement, achieved
from tuners.recalibration.watch import Watch
from yawrate_env.plant.entry import from_file
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

Array = NDArray[np.float64]

MEANT = {
    Agreement.KEPT: "As promised.",
    Agreement.MISSED: "Not as promised.",
    Agreement.UNKNOWN: "This drive cannot tell: record stronger or longer steering.",
}
NOT_KEPT = 3


@click.command(
    epilog=example("yawrate check drive.csv --kp 0.12 --Ti 0.21 --reference yaw_rate_ref")
)
@click.argument("log", type=READABLE)
@log_options
@click.option("--kp", type=NONZERO, required=True, help="kp of the PI that drove.")
@click.option("--Ti", "Ti", type=POSITIVE, required=True, help="Ti of the PI that drove [s].")
@click.option("--phase-margin", type=NUMBER, help="Promised, instead of the target's [deg].")
@click.option("--crossover", type=POSITIVE, help="Promised, instead of the target's [Hz].")
@vehicle_option
@click.option("--json", "machine", is_flag=True, help="Print one JSON object.")
def command(
    log: Path,
    options: Options,
    kp: float,
    Ti: float,
    phase_margin: float | None,
    crossover: float | None,
    vehicle: Path | None,
    machine: bool,
) -> None:
    """Check the margins that gains achieve, from a LOG of a drive with them.

    The LOG is one of the closed loop: command, output, and the reference if --reference names its
    column; otherwise the reference is rebuilt from the gains.  Phase margin and crossover are those
    on the vehicle that explains the drive, with 90 % intervals, beside those promised; what the
    recording alone shows stands below, and counts where no vehicle explains it.

    Exit status: 0 as promised, 3 not or cannot tell, 1 unusable data, 2 wrong usage.
    """
    plant, task = _plant(vehicle)
    trained = load("bb", plant)
    try:
        drive = read_log(log, plant, whole(options))
    except SelectionError as error:
        raise click.UsageError(str(error)) from None
    (recording,) = recordings(plant, [drive])
    given = zip(plant.counted, (phase_margin, crossover), strict=True)
    promised = {name: value for name, value in given if value is not None}
    modelled = None if task is None else _modelled(task, drive, (kp, Ti))
    found = achieved(trained, recording, (kp, Ti), promised, modelled)
    click.echo(_json(found, drive) if machine else _text(found, drive))
    sys.exit(0 if found.agreement is Agreement.KEPT else NOT_KEPT)


def _plant(file: Path | None) -> tuple[Plant, Task | None]:
    """The plant of a file, and its task if it is a vehicle."""
    other = None if file is None else from_file(file)
    if other is not None:
        if other.loop_target is None:
            raise click.UsageError(
                f"--plant {file}: phase margin and crossover are compared, and this plant has no "
                "target of one PI loop. Leave it out, or give another plant."
            )
        return other, None
    task = task_of(file)
    return yaw_rate(task, check=False), task


def _modelled(task: Task, drive: Log, gains: tuple[float, float]) -> tuple[Array, Array] | None:
    """Margins on the vehicle that explains the drive, and deviations; None where none does."""
    advice = Watch(drives_of(task), gains, suspects={}).add(
        drive.u, drive.y, drive.Ts, drive.measured["v_x"]
    )
    if advice.left:
        return None
    metrics, spread = np.array([advice.phase_margin, advice.crossover]).T
    return metrics, spread


def _text(found: Achieved, drive: Log) -> str:
    lines = [f"{drive.source}: {drive.duration:.1f} s", ""]
    for name, interval in found.intervals.items():
        word, unit = split(name)
        value, low, high, wanted = (
            f"{x:.4g}" for x in (interval.value, interval.low, interval.high, found.promised[name])
        )
        ends = f"90 %: {low} to {high}"
        alone = found.alone[name]
        title = word.replace("_", " ").capitalize()
        lines.append(f"{title}: {value} {unit} ({ends}), promised {wanted}")
        shown = f"{alone.value:.4g} ({alone.low:.4g} to {alone.high:.4g})"
        shown = shown if np.isfinite(alone.value) else "it cannot tell"
        lines.append(f"  from the recording alone: {shown}")
    lines += ["", MEANT[found.agreement], *(f"Note: {note}" for note in drive.notes)]
    return "\n".join(lines)


def _json(found: Achieved, drive: Log) -> str:
    metrics = {
        split(name)[0]: {**{k: _finite(v) for k, v in asdict(interval).items()},
                         "promised": found.promised[name]}
        for name, interval in found.intervals.items()
    }  # fmt: skip
    whole = {"agreement": found.agreement, "metrics": metrics, "notes": list(drive.notes)}
    return json.dumps(whole, indent=1, allow_nan=False)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
