"""Quantities with time stamps, or clocks of their own, to arrays on one even grid."""

from dataclasses import dataclass

import numpy as np

from tuners.logs.lost import without_lost
from tuners.logs.quantities import Quantity
from tuners.logs.stamps import line, order, unwrapped
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
    found, words = _own_clocks(found, plan)
    values = {role: q.values for role, q in found.items() if role != "time"}
    time, joined = _time(found, plan)
    words += joined
    if found[plan.clock].time is not None and not _by_row(found, plan):
        clock = found[plan.clock].time
        values = {role: _onto(clock, found[role], role in plan.held) for role in values}
        words += _apart(found, plan)
    sizes = {found[role].name: len(array) for role, array in values.items()} | {"time": len(time)}
    if len(set(sizes.values())) > 1:
        listed = ", ".join(f"{name} {size}" for name, size in sizes.items())
        raise LogError(f"The columns have different lengths: {listed}.")
    words += [_sparse(found[role], values[role]) for role in plan.slow if role in values]
    values[plan.clock], left_out = without_lost(found[plan.clock].name, values[plan.clock])
    words += left_out
    values |= {role: _filled(values[role]) for role in plan.slow if role in values}
    if plan.begin is not None:
        time, values = _from(plan.begin, time, values)
    complete = np.asarray((np.abs([time, *values.values()]) < _NONSENSE).all(axis=0))
    lost = len(time) - int(complete.sum())
    words += [f"Rows without a number somewhere were left out: {lost}."] if lost else []
    if plan.begin is not None and not complete[:1].all():
        raise LogError(
            "The first row lacks a number, and the recording must begin where the plant starts. "
            "Repair it, or choose a stretch that begins with a start with --from."
        )
    time, values = time[complete], {role: array[complete] for role, array in values.items()}
    time, values, changed = _in_order(*_once(time, values))
    words += changed
    base = time_base(time, plan.least, plan.pace, plan.begin is not None, values[plan.clock])
    on_grid = {}
    for role, array in values.items():
        stretch = array[base.rows]
        on_grid[role] = stretch if base.even else _resampled(base, stretch, role in plan.held)
    words = [word for word in words if word]
    return base, {role: np.array(a, dtype=np.float64) for role, a in on_grid.items()}, words


def _own_clocks(found: dict[str, Quantity], plan: Plan) -> tuple[dict[str, Quantity], list[str]]:
    """Columns that hardly ever have values in one row, each with the stamps of its own rows."""
    both = [found["input"], found[plan.clock]]
    if "time" not in found or plan.Ts is not None or any(q.time is not None for q in both):
        return found, []
    time = found["time"].values
    if any(q.values.shape != time.shape for q in both):
        return found, []
    known = [np.isfinite(q.values) & np.isfinite(time) for q in both]
    if (
        not min(k.sum() for k in known)
        or (known[0] & known[1]).sum() > min(k.sum() for k in known) / 2
    ):
        return found, []
    apart = {"time": found["time"]}
    for role, q in found.items():
        if role != "time":
            rows = np.isfinite(q.values) & np.isfinite(time)
            apart[role] = Quantity(q.name, q.values[rows], time[rows])
    return apart, []


def _by_row(found: dict[str, Quantity], plan: Plan) -> bool:
    """Whether channels are taken row by row, whatever their stamps: as many, and Ts is given."""
    return (
        plan.Ts is not None and len({len(q.values) for r, q in found.items() if r != "time"}) == 1
    )


def _apart(found: dict[str, Quantity], plan: Plan) -> list[str]:
    """A note on channels whose stamps are not those of the output."""
    clock, notes = found[plan.clock], []
    for role, q in found.items():
        if role in ("time", plan.clock, *plan.slow) or q.time is None or _same(clock.time, q.time):
            continue
        assert clock.time is not None
        after = np.searchsorted(q.time, clock.time, side="right") - 1
        late = clock.time[after >= 0] - q.time[after[after >= 0]]
        notes.append(
            f"Columns {q.name} and {clock.name} have clocks of their own, "
            f"{1e3 * float(np.median(late)):.3g} ms apart, which was counted."
        )
    return notes


def _sparse(quantity: Quantity, values: Array) -> str:
    """A note on a measured parameter that has hardly any readings."""
    known = int(np.isfinite(quantity.values).sum())
    few = 0 < known < max(2, len(values) // 100)
    readings = f"{known} reading{'s' * (known > 1)}"
    return f"Column {quantity.name} has {readings} in {len(values)} rows." if few else ""


def _once(time: Array, values: dict[str, Array]) -> tuple[Array, dict[str, Array], list[str]]:
    """Without rows that repeat the one before, where that is what repeated stamps come from."""
    rows = np.stack([time, *values.values()])
    stamp = np.diff(time, prepend=np.nan) == 0
    again = stamp & (np.diff(rows, axis=1, prepend=np.nan) == 0).all(axis=0)
    if not again.any() or again.sum() < 0.8 * stamp.sum():
        return time, values, []
    kept = {role: array[~again] for role, array in values.items()}
    return time[~again], kept, [f"Rows that repeat the one before were left out: {again.sum()}."]


def _from(begin: float, time: Array, values: dict[str, Array]) -> tuple[Array, dict[str, Array]]:
    """Rows from a time on; all where there are none, which is for the choice to refuse."""
    early = time < begin - 1e-9
    kept = slice(int(np.argmin(early)), None)  # the first that is not early, or else all
    return time[kept], {role: array[kept] for role, array in values.items()}


def _in_order(
    time: Array, values: dict[str, Array], notes: list[str]
) -> tuple[Array, dict[str, Array], list[str]]:
    """Rows that came shuffled by a few, sorted by their stamps."""
    ranks = order(time)
    if ranks is None:
        return time, values, notes
    moved = int((ranks != np.arange(len(time))).sum())
    note = f"Rows out of order were sorted by time: {moved}."
    return time[ranks], {role: a[ranks] for role, a in values.items()}, [*notes, note]


def _time(found: dict[str, Quantity], plan: Plan) -> tuple[Array, tuple[str, ...]]:
    """Stamps of the clock's rows, wrapped counters joined; and notes."""
    if plan.Ts is not None:
        count = len(found[plan.clock].values)
        return np.asarray(plan.Ts * np.arange(count, dtype=np.float64)), ()
    own = found[plan.clock].time
    if own is not None:
        return own, ()
    if "time" not in found:
        raise LogError(
            "No column looks like time. Name one with --time-column, or give --Ts in seconds."
        )
    return unwrapped(found["time"].values)


def _onto(clock: Array | None, quantity: Quantity, held: bool) -> Array:
    """A channel with its own clock, at the times of another.

    A command is held between its stamps: over each of the clock's steps its mean counts, so that
    one that came a millisecond after a stamp is a millisecond late.
    """
    assert quantity.time is not None and clock is not None
    if _same(clock, quantity.time):
        return quantity.values
    time = quantity.time
    if not held or len(clock) < 2:
        return np.interp(clock, time, quantity.values, np.nan, np.nan).astype(np.float64)
    jittering = line(time)
    if jittering is not None:
        time = jittering.start + jittering.Ts * jittering.count
    rounding = EVEN * float(np.median(np.diff(clock)))
    near = np.clip(np.searchsorted(clock, time - rounding), 0, len(clock) - 1)
    time = np.where(np.abs(clock[near] - time) <= rounding, clock[near], time)
    area = np.concatenate([[0.0], np.cumsum(quantity.values[:-1] * np.diff(time))])
    ends = np.append(clock, 2 * clock[-1] - clock[-2])
    last = area[-1] + quantity.values[-1] * np.maximum(ends - time[-1], 0.0)
    sums = np.where(ends > time[-1], last, np.interp(ends, time, area))
    steps = np.diff(ends)
    with np.errstate(divide="ignore", invalid="ignore"):
        means = np.diff(sums) / steps
    before = np.maximum(np.searchsorted(time, clock, side="right") - 1, 0)
    means = np.where(steps > 0, means, quantity.values[before])
    return np.where(clock >= time[0], means, np.nan)


def _same(clock: Array | None, time: Array | None) -> bool:
    """Whether two channels have the same stamps but for rounding."""
    if clock is None or time is None or clock.shape != time.shape:
        return False
    rounding = EVEN * float(np.median(np.diff(clock))) if len(clock) > 1 else 0.0
    return np.allclose(time, clock, 0.0, max(rounding, 0.0))


def _filled(values: Array) -> Array:
    """Missing values of what changes slowly, and is often recorded less often, interpolated."""
    index, known = np.arange(len(values)), np.isfinite(values)
    return np.asarray(np.interp(index, index[known], values[known]) if known.any() else values)


def _resampled(base: TimeBase, values: Array, held: bool) -> Array:
    """At the times of the grid: a command is held, what is measured is interpolated."""
    times = base.times
    if held:
        # A stamp that is late by jitter still belongs to its grid point.
        index = np.searchsorted(times, base.grid + 0.5 * base.Ts, side="right") - 1
        return np.asarray(values[index])
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(times, values)(base.grid))
