"""Quantities with time stamps, or clocks of their own, to arrays on one even grid."""

from dataclasses import dataclass

import numpy as np

from tuners.logs.columns import Quantity
from tuners.logs.table import Array, LogError
from tuners.logs.time_base import EVEN, Pace, TimeBase, time_base

_NONSENSE = 1e20  # in any unit; epochs in ns are 2e18


@dataclass(frozen=True, slots=True)
class Plan:
    """What must be known of the quantities to bring them to one grid.

    Attributes
    ----------
    clock : str
        The role whose own time stamps count, in formats where every quantity has some.
    least : float
        Shortest stretch worth having [s].
    pace : Pace
        Sampling times that make sense.
    held : tuple of str
        Roles that keep a value until the next one; others are interpolated.
    slow : tuple of str
        Roles that change slowly: where their values are missing, these are interpolated.
    Ts : float or None
        Sampling time [s], where no time column is to be used.
    begin : float or None
        Time of which only what begins with the first row from then on can be used [s].
    """

    clock: str
    least: float
    pace: Pace
    held: tuple[str, ...] = ()
    slow: tuple[str, ...] = ()
    Ts: float | None = None
    begin: float | None = None


def sampled(found: dict[str, Quantity], plan: Plan) -> tuple[TimeBase, dict[str, Array], list[str]]:
    """Every quantity on one even grid; rows with a missing value are left out first."""
    values = {role: q.values for role, q in found.items() if role != "time"}
    time = _time(found, plan)
    if found[plan.clock].time is not None:
        values = {role: _onto(time, found[role], role in plan.held) for role in values}
    sizes = {found[role].name: len(array) for role, array in values.items()} | {"time": len(time)}
    if len(set(sizes.values())) > 1:
        listed = ", ".join(f"{name} {size}" for name, size in sizes.items())
        raise LogError(f"The columns have different lengths: {listed}.")
    values |= {role: _filled(values[role]) for role in plan.slow if role in values}
    if plan.begin is not None:
        time, values = _from(plan.begin, time, values)
    complete = np.asarray((np.abs([time, *values.values()]) < _NONSENSE).all(axis=0))
    lost = len(time) - int(complete.sum())
    words = [f"Rows without a number somewhere were left out: {lost}."] if lost else []
    if plan.begin is not None and not complete[:1].all():
        raise LogError(
            "The first row lacks a number, and the recording must begin where the plant starts. "
            "Repair it, or choose a stretch that begins with a start with --from."
        )
    time = time[complete]
    base = time_base(time, plan.least, plan.pace, plan.begin is not None)
    on_grid = {}
    for role, array in values.items():
        stretch = array[complete][base.rows]
        on_grid[role] = stretch if base.even else _resampled(time, base, stretch, role in plan.held)
    return base, {role: np.array(a, dtype=np.float64) for role, a in on_grid.items()}, words


def _from(begin: float, time: Array, values: dict[str, Array]) -> tuple[Array, dict[str, Array]]:
    """Rows from a time on; all where there are none, which is for the choice to refuse."""
    early = time < begin - 1e-9
    kept = slice(int(np.argmin(early)), None)  # the first that is not early, or else all
    return time[kept], {role: array[kept] for role, array in values.items()}


def _time(found: dict[str, Quantity], plan: Plan) -> Array:
    if plan.Ts is not None:
        count = len(found[plan.clock].values)
        return np.asarray(plan.Ts * np.arange(count, dtype=np.float64))
    own = found[plan.clock].time
    if own is not None:
        return own
    if "time" not in found:
        raise LogError(
            "No column looks like time. Name one with --time-column, or give --Ts in seconds."
        )
    return found["time"].values


def _onto(time: Array, quantity: Quantity, held: bool) -> Array:
    """A channel with its own clock, at the times of another: commands are held."""
    assert quantity.time is not None
    rounding = EVEN * float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    if quantity.time.shape == time.shape and np.allclose(quantity.time, time, 0.0, rounding):
        return quantity.values
    if held:
        before = np.searchsorted(quantity.time, time + rounding, side="right") - 1
        return np.where(before >= 0, quantity.values[before], np.nan)
    return np.interp(time, quantity.time, quantity.values, np.nan, np.nan).astype(np.float64)


def _filled(values: Array) -> Array:
    """Missing values of what changes slowly, and is often recorded less often, interpolated."""
    index, known = np.arange(len(values)), np.isfinite(values)
    return np.asarray(np.interp(index, index[known], values[known]) if known.any() else values)


def _resampled(time: Array, base: TimeBase, values: Array, held: bool) -> Array:
    """At the times of the grid: a command is held, what is measured is interpolated."""
    times = time[base.rows]
    if held:
        # A stamp that is late by jitter still belongs to its grid point.
        index = np.searchsorted(times, base.grid + 0.5 * base.Ts, side="right") - 1
        return np.asarray(values[index])
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(times, values)(base.grid))
