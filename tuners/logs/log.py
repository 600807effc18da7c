"""A recording that a tuner can use, and how it comes out of a file."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tuners.logs import columns, excitation
from tuners.logs.actuator import through_actuator
from tuners.logs.columns import Choice, Quantity
from tuners.logs.excitation import Excitation
from tuners.logs.formats import read_table
from tuners.logs.table import Array, LogError, SelectionError
from tuners.logs.time_base import TimeBase, time_base
from yawrate_env.task import Task

_NONSENSE = 1e20  # in any unit; epochs in ns are 2e18

LONGEST = 20.0
"""How much of a recording is used [s], unless a stretch is chosen."""


@dataclass(frozen=True, slots=True)
class Options:
    """What the user says about a recording; what is not said is found out.

    Attributes
    ----------
    choice : Choice
        Columns and units.
    Ts : float or None
        Sampling time [s], where there is no time column or it is not to be used.
    speed : float or None
        Constant speed [m/s], instead of a column.
    steer_ratio : float
        Hand-wheel angle over road-wheel angle.
    steer_sign, yaw_rate_sign : int
        -1 turns a signal round.
    start, stop : float or None
        Stretch to use, in the recording's own time [s].
    steer_is : {"command", "measured"}
        What the actuator was told, or the road-wheel angle that came of it.
    """

    choice: Choice = field(default_factory=Choice)
    Ts: float | None = None
    speed: float | None = None
    steer_ratio: float = 1.0
    steer_sign: int = 1
    yaw_rate_sign: int = 1
    start: float | None = None
    stop: float | None = None
    steer_is: str = "command"


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
    base, signals, lost = _sampled(found, options)
    notes = [*table.notes, *lost, *_column_notes(found, options), *base.notes]
    signals["steer"] *= options.steer_sign / options.steer_ratio
    signals["yaw_rate"] *= options.yaw_rate_sign
    if options.speed is None and "speed" not in found:
        signals["speed"] = np.full(len(base.grid), _only_speed(task))
        notes.append(f"No speed in the log: taken as the tuner's {signals['speed'][0]:g} m/s.")
    elif options.speed is not None:
        signals["speed"] = np.full(len(base.grid), options.speed)
    part, chosen = _stretch(base, signals, task, options)
    notes += chosen
    steer, yaw_rate, speed = (signals[name][part] for name in ("steer", "yaw_rate", "speed"))
    judged = excitation.check(steer, yaw_rate, speed, base.Ts, task.target.crossover)
    Ts = base.Ts
    if options.steer_is == "measured":
        steer, yaw_rate, Ts, parts = through_actuator(steer, yaw_rate, Ts, task.vehicle)
        speed = np.repeat(speed[:-1], parts)
        notes.append("Measured road-wheel angle: the yaw rate was filtered through the actuator.")
    notes += judged.notes
    t0 = float(base.grid[part.start])
    return Log(path.name, t0, Ts, base.Ts, steer, yaw_rate, speed, judged, tuple(notes))


def _sampled(
    found: dict[str, Quantity], options: Options
) -> tuple[TimeBase, dict[str, Array], list[str]]:
    """Every quantity on one even grid; rows with a missing value are left out first."""
    values = {role: q.values for role, q in found.items() if role != "time"}
    if options.speed is not None:
        values.pop("speed", None)
    time = _time(found, len(found["yaw_rate"].values), options)
    if found["yaw_rate"].time is not None:
        values = {role: _onto(time, found[role], role) for role in values}
    sizes = {found[role].name: len(array) for role, array in values.items()} | {"time": len(time)}
    if len(set(sizes.values())) > 1:
        listed = ", ".join(f"{name} {size}" for name, size in sizes.items())
        raise LogError(f"The columns have different lengths: {listed}.")
    complete = (np.abs([time, *values.values()]) < _NONSENSE).all(axis=0)
    lost = len(time) - int(complete.sum())
    words = [f"{lost} rows have no number somewhere and were left out."] if lost else []
    time = time[complete]
    base = time_base(time, excitation.SHORTEST)
    on_grid = {}
    for role, array in values.items():
        stretch = array[complete][base.rows]
        held = role == "steer" and options.steer_is == "command"
        on_grid[role] = stretch if base.even else _resampled(time, base, stretch, held)
    return base, {role: np.array(a, dtype=np.float64) for role, a in on_grid.items()}, words


def _time(found: dict[str, Quantity], count: int, options: Options) -> Array:
    if options.Ts is not None:
        return np.asarray(options.Ts * np.arange(count, dtype=np.float64))
    own = found["yaw_rate"].time
    if own is not None:
        return own
    if "time" not in found:
        raise LogError(
            "No column looks like time. Name one with --time-column, or give --Ts in seconds."
        )
    return found["time"].values


def _onto(time: Array, quantity: Quantity, role: str) -> Array:
    """A channel with its own clock, at the times of another: commands are held."""
    assert quantity.time is not None
    if quantity.time.shape == time.shape and (quantity.time == time).all():
        return quantity.values
    if role == "steer":
        before = np.searchsorted(quantity.time, time, side="right") - 1
        return np.where(before >= 0, quantity.values[before], np.nan)
    return np.interp(time, quantity.time, quantity.values, np.nan, np.nan).astype(np.float64)


def _resampled(time: Array, base: TimeBase, values: Array, held: bool) -> Array:
    """At the times of the grid: a command is held, what is measured is interpolated."""
    times = time[base.rows]
    if held:
        # A stamp that is late by jitter still belongs to its grid point.
        index = np.searchsorted(times, base.grid + 0.5 * base.Ts, side="right") - 1
        return np.asarray(values[index])
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(times, values)(base.grid))


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
    t = base.grid
    if options.start is None and options.stop is None:
        part, shorter = excitation.best_stretch(
            signals["steer"], signals["speed"], base.Ts, task.target.crossover, LONGEST
        )
        words = f"Best-excited stretch used: {t[part.start]:.4g} to {t[part.stop - 1]:.4g} s."
        return part, [words] if shorter else []
    start = t[0] if options.start is None else options.start
    stop = t[-1] if options.stop is None else options.stop
    part = slice(*(int(i) for i in np.searchsorted(t, [start - 1e-9, stop + 1e-9])))
    if part.stop - part.start < 2:
        raise SelectionError(
            f"Nothing between {start:g} and {stop:g} s: the usable recording runs from "
            f"{t[0]:.4g} to {t[-1]:.4g} s."
        )
    return part, []
