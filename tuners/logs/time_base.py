"""Find evenly sampled stretches in time stamps.

Stamps within `EVEN` of a sampling time of an even grid are taken as that grid: they are
rounded, and the samples are not.  So are stamps that jitter, unless the output shows that the
samples do (`tuners.logs.stamps`); these are resampled.  A longer break splits the recording; so
does a clock that stands still or runs backwards.
"""

from dataclasses import dataclass

import numpy as np

from tuners.logs import stamps
from tuners.logs.stamps import Line
from tuners.logs.table import Array, LogError
from tuners.tuner.sampling import slowest
from yawrate_env.plant.plant import Plant

EVEN = 0.02


@dataclass(frozen=True, slots=True)
class Pace:
    """Sampling times that make sense for a plant.

    Attributes
    ----------
    fastest, slowest : float
        Sampling times that are accepted [s].
    bridged : float
        Longest step that is interpolated over [s].
    """

    fastest: float
    slowest: float
    bridged: float


def pace_of(plant: Plant) -> Pace:
    """Up to what the plant's tuner takes, and half of that without a sample."""
    limit = slowest(plant)
    return Pace(plant.Ts / 500, limit, limit / 2)


@dataclass(frozen=True, slots=True, eq=False)
class TimeBase:
    """An even grid for one stretch of a recording.

    Attributes
    ----------
    rows : slice
        Rows of the recording.
    times : NDArray
        (M,) when these were sampled [s].
    grid : NDArray
        (N,) times of its even samples [s].
    Ts : float
        Their distance [s].
    even : bool
        Whether the rows are on the grid already.
    notes : tuple of str
        What had to be done, in words.
    """

    rows: slice
    times: Array
    grid: Array
    Ts: float
    even: bool
    notes: tuple[str, ...]


def time_base(
    time: Array, least: float, pace: Pace, from_first: bool = False, y: Array | None = None
) -> TimeBase:
    """Find an even grid in time stamps (N,) [s] of at least `least` [s], or say why not.

    The longest stretch without a break has it, or `from_first` that before the first break.
    The output (N,) tells whether samples jitter as their stamps do.
    """
    if len(time) < 10:
        raise LogError(f"Only {len(time)} complete samples: record more.")
    if not (np.diff(time) > 0).any():
        raise LogError("Time does not run forwards anywhere.")
    whole = stamps.line(time)
    Ts = whole.Ts if whole is not None else _usual_step(time)
    if not pace.fastest <= Ts <= pace.slowest:
        raise LogError(
            f"The sampling time is {Ts:g} s; it must lie between {pace.fastest:g} and "
            f"{pace.slowest:g} s. If the time is not in seconds, give --time-unit."
        )
    if whole is not None:
        return _grid(time, slice(0, len(time)), y, ())
    longest = max(1.5 * Ts, min(3.5 * Ts, pace.bridged))
    rows, notes = _unbroken(time, longest, least, from_first)
    return _grid(time, rows, y, notes)


def _usual_step(time: Array) -> float:
    """The median step; refused where most steps are none."""
    steps = np.diff(time)
    repeated = float((steps == 0).mean())
    if repeated > 0.5:
        raise LogError(
            f"{repeated:.0%} of the time stamps repeat the one before: they are too coarse for the "
            "samples. Give the sampling time in seconds with --Ts."
        )
    return float(np.median(steps[steps > 0]))


def _unbroken(
    time: Array, longest: float, least: float, from_first: bool
) -> tuple[slice, tuple[str, ...]]:
    """Rows of the longest stretch, or the first, without a step back or one above `longest`."""
    steps = np.diff(time)
    breaks = np.flatnonzero((steps <= 0) | (steps > longest))
    ends = np.concatenate([[0], breaks + 1, [len(time)]])
    spans = np.array([time[j - 1] - time[i] for i, j in zip(ends, ends[1:], strict=False)])
    best = 0 if from_first else int(np.argmax(spans))
    rows = slice(int(ends[best]), int(ends[best + 1]))
    if not len(breaks):
        return rows, ()
    where = _break(time, int(breaks[0]))
    if spans[best] < least and from_first:
        raise LogError(
            f"{where}, and the {spans[best]:.2f} s before it are too short: at least "
            f"{least:g} s are needed, from the plant's start on. Choose a stretch that begins "
            "with one with --from."
        )
    if spans[best] < least:
        raise LogError(
            f"{where}, and no stretch without a break is {least:g} s long "
            f"(the longest is {spans[best]:.2f} s)."
        )
    used = "the part before it" if from_first else "the longest stretch without a break"
    left = len(time) - (rows.stop - rows.start)
    return rows, (f"{where}: {used} is used; {left} samples are not.",)


def _grid(time: Array, rows: slice, y: Array | None, notes: tuple[str, ...]) -> TimeBase:
    """Least squares through the stamps, after counting how many samples each step spans."""
    t = time[rows]
    found = _line(t)
    Ts = _rounded(found.Ts)
    rounded = found.jitter <= EVEN * Ts
    start = float(t[0]) if rounded else found.start
    grid: Array = start + Ts * np.arange(int(found.count[-1]) + 1, dtype=np.float64)
    if rounded and not found.lost:
        return TimeBase(rows, t, grid, Ts, True, notes)
    lost = f"{found.lost} sample{'s' * (found.lost > 1)} lost"
    if not rounded and y is not None and stamps.taken_when_stamped(found, y[rows]):
        words = f"Time stamps are off an even grid by up to {1e3 * found.jitter:.3g} ms"
        words += f", {lost}" * bool(found.lost) + f": resampled to {1e3 * Ts:.5g} ms."
        grid = t[0] + Ts * np.arange(len(grid), dtype=np.float64)
        return TimeBase(rows, t, grid[grid <= t[-1]], Ts, False, (*notes, words))
    if not rounded:
        notes = (*notes, (
            f"Time stamps jitter by up to {1e3 * found.jitter:.3g} ms: the samples were taken as "
            f"evenly spaced, every {1e3 * Ts:.5g} ms."
        ))  # fmt: skip
    if found.lost:
        notes = (*notes, f"{lost}: resampled to {1e3 * Ts:.5g} ms.")
    times = t if rounded else np.asarray(found.start + Ts * found.count)
    return TimeBase(rows, times, grid, Ts, not found.lost, notes)


def _line(t: Array) -> Line:
    """The even samples behind stamps without a break."""
    steps = np.diff(t)
    step = float(np.median(steps))
    clean = stamps.counted(t, np.maximum(1, np.rint(steps / step))) if step > 0 else None
    if clean is not None and clean.jitter <= EVEN * clean.Ts and clean.lost < len(t):
        return clean
    return stamps.line(t) or stamps.line_with_losses(t)


def _rounded(Ts: float) -> float:
    """Without the noise of the stamps: 0.0100000003 s is 0.01 s."""
    close = float(f"{Ts:.4g}")
    return close if abs(close / Ts - 1) < 1e-5 else Ts


def _break(time: Array, k: int) -> str:
    step = time[k + 1] - time[k]
    what = f"A gap of {step:.3g} s" if step > 0 else "Time stands still or runs backwards"
    return f"{what} at t = {time[k]:.6g} s (sample {k + 2})"
