"""A recording that a tuner can use, and how it comes out of a file."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tuners.logs import columns, excitation
from tuners.logs.actuator import through_actuator
from tuners.logs.columns import Quantity
from tuners.logs.excitation import Band, Excitation, band_around
from tuners.logs.formats import read_table
from tuners.logs.options import Options
from tuners.logs.sampling import Plan, sampled
from tuners.logs.table import Array, LogError, SelectionError
from tuners.logs.time_base import TimeBase
from yawrate_env.vehicle.single_track import Vehicle
from yawrate_env.vehicle.task import Task

LONGEST = 20.0
"""How much of a recording is used [s], unless a stretch is chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """An evenly sampled stretch of a recording, SI units.

    Attributes
    ----------
    source : str
        Name of the file.
    t0 : float
        Time of the first sample, as the recording counts it [s].
    Ts, recorded_Ts : float
        Sampling time of these arrays, and of the file [s].
    steer : NDArray
        (N,) steering command at the road wheel [rad], held over a sampling time.
    yaw_rate : NDArray
        (N,) measured yaw rate [rad/s].
    speed : NDArray
        (N,) speed [m/s].
    excitation : Excitation
        How it excites the vehicle.
    notes : tuple of str
        What was found out or had to be done, in words.
    """

    source: str
    t0: float
    Ts: float
    recorded_Ts: float
    steer: Array
    yaw_rate: Array
    speed: Array
    excitation: Excitation
    notes: tuple[str, ...]

    @property
    def time(self) -> Array:
        """(N,) as the recording counts it [s]."""
        return np.asarray(self.t0 + self.Ts * np.arange(len(self.steer), dtype=np.float64))


def read_log(path: Path, task: Task, options: Options) -> Log:
    """Read a recording for a tuner of this task.

    Raises
    ------
    LogError
        It cannot be used; the message says why.
    SelectionError
        It has no such column or stretch.
    """
    table = read_table(path)
    found = columns.find(table, options.choice)
    if options.speed is not None:
        found.pop("speed", None)
    held = ("steer",) if options.steer_is == "command" else ()
    plan = Plan("yaw_rate", excitation.SHORTEST, held, ("speed",), options.Ts)
    base, signals, lost = sampled(found, plan)
    notes = [*table.notes, *lost, *_column_notes(found, options), *base.notes]
    signals["steer"] *= options.steer_sign / options.steer_ratio
    signals["yaw_rate"] *= options.yaw_rate_sign
    if "speed" not in signals:
        signals["speed"] = np.full(len(base.grid), options.speed or _only_speed(task))
    part, chosen = _stretch(base, signals, task, options)
    log = _log(path.name, base, signals, part, task)
    log = replace(log, notes=(*notes, *chosen, *log.excitation.notes))
    return _whole_vehicle(log, task.vehicle) if options.steer_is == "measured" else log


def _log(source: str, base: TimeBase, signals: dict[str, Array], part: slice, task: Task) -> Log:
    """One stretch, after a look at its excitation."""
    steer, yaw_rate, speed = (signals[name][part] for name in ("steer", "yaw_rate", "speed"))
    judged = excitation.check(steer, yaw_rate, speed, base.Ts, task.target.crossover)
    t0 = float(base.grid[part.start])
    return Log(source, t0, base.Ts, base.Ts, steer, yaw_rate, speed, judged, ())


def _whole_vehicle(log: Log, vehicle: Vehicle) -> Log:
    """A log of commands from one of measured road-wheel angles."""
    steer, yaw_rate, Ts, parts = through_actuator(log.steer, log.yaw_rate, log.Ts, vehicle)
    words = "Measured road-wheel angle: the yaw rate was filtered through the actuator."
    return replace(
        log,
        Ts=Ts,
        steer=steer,
        yaw_rate=yaw_rate,
        speed=np.repeat(log.speed[:-1], parts),
        notes=(*log.notes, words),
    )


def _column_notes(found: dict[str, Quantity], options: Options) -> list[str]:
    notes = []
    for role, quantity in found.items():
        given = options.choice.units.get(role) is not None
        if not given and quantity.unit not in ("s", "rad", "rad/s", "m/s"):
            notes.append(f"Column {quantity.name} is taken to be in {quantity.unit}.")
    if columns.is_hand_wheel(found["steer"].name) and options.steer_ratio == 1.0:
        notes.append(
            f"Column {found['steer'].name} sounds like the hand wheel, and no --steer-ratio is "
            "given: it is taken as the road wheel."
        )
    if options.speed is None and "speed" not in found:
        notes.append("No speed in the log: taken as the tuner's.")
    return notes


def _only_speed(task: Task) -> float:
    low, high = task.prior.v_x
    if low != high:
        raise LogError(
            f"No column looks like speed, and this tuner covers {low:g} to {high:g} m/s. "
            "Give --speed, or name a column with --speed-column."
        )
    return low


def _stretch(
    base: TimeBase, signals: dict[str, Array], task: Task, options: Options
) -> tuple[slice, list[str]]:
    if options.start is not None or options.stop is not None:
        return between(base.grid, options.start, options.stop), []
    return best_excited(
        base, signals["steer"], [signals["speed"]], band_around(task.target.crossover), LONGEST
    )


def best_excited(
    base: TimeBase, u: Array, beside: list[Array], band: Band | None, length: float
) -> tuple[slice, list[str]]:
    """The stretch of `length` [s] that is excited best, and a note if it is not everything."""
    part, shorter = excitation.best_stretch(u, beside, base.Ts, band, length)
    first, last = base.grid[[part.start, part.stop - 1]]
    return part, [f"Best-excited stretch used: {first:.2f} to {last:.2f} s."] if shorter else []


def between(t: Array, start: float | None, stop: float | None) -> slice:
    """The part of times (N,) that was asked for; from or to the end where nothing was."""
    start = t[0] if start is None else start
    stop = t[-1] if stop is None else stop
    part = slice(*(int(i) for i in np.searchsorted(t, [start - 1e-9, stop + 1e-9])))
    if part.stop - part.start < 2:
        raise SelectionError(
            f"Nothing between {start:g} and {stop:g} s: the usable recording runs from "
            f"{t[0]:.2f} to {t[-1]:.2f} s."
        )
    return part
