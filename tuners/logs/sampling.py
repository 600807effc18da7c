"""Quantities with time stamps, or clocks of their own, to arrays on one even grid."""

import numpy as np

from tuners.logs.columns import Quantity
from tuners.logs.excitation import SHORTEST
from tuners.logs.options import Options
from tuners.logs.table import Array, LogError
from tuners.logs.time_base import TimeBase, time_base

_NONSENSE = 1e20  # in any unit; epochs in ns are 2e18


def sampled(
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
    if "speed" in values:
        values["speed"] = _filled(values["speed"])
    complete = (np.abs([time, *values.values()]) < _NONSENSE).all(axis=0)
    lost = len(time) - int(complete.sum())
    words = [f"Rows without a number somewhere were left out: {lost}."] if lost else []
    time = time[complete]
    base = time_base(time, SHORTEST)
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


def _filled(speed: Array) -> Array:
    """Missing speeds interpolated: it changes slowly, and is often recorded less often."""
    index, known = np.arange(len(speed)), np.isfinite(speed)
    return np.asarray(np.interp(index, index[known], speed[known]) if known.any() else speed)


def _resampled(time: Array, base: TimeBase, values: Array, held: bool) -> Array:
    """At the times of the grid: a command is held, what is measured is interpolated."""
    times = time[base.rows]
    if held:
        # A stamp that is late by jitter still belongs to its grid point.
        index = np.searchsorted(times, base.grid + 0.5 * base.Ts, side="right") - 1
        return np.asarray(values[index])
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(times, values)(base.grid))
