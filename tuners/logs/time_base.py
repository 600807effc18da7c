"""Find evenly sampled stretches in time stamps.

Stamps within `EVEN` of a sampling time of an even grid are taken as that grid: they are
rounded, and the samples are not.  Larger jitter is resampled.  A longer break splits the
recording; so does a clock that stands still or runs backwards.
"""

from dataclasses import dataclass

import numpy as np

from tuners.logs.table import Array, LogError
from tuners.tuner.tuner import slowest
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
    grid: Array
    Ts: float
    even: bool
    notes: tuple[str, ...]


def time_base(time: Array, least: float, pace: Pace, from_first: bool = False) -> TimeBase:
    """Find an even grid in time stamps (N,) [s] of at least `least` [s], or say why not.

    The longest stretch without a break has it, or `from_first` that before the first break.
    """
    if len(time) < 10:
        raise LogError(f"Only {len(time)} complete samples: record more.")
    steps = np.diff(time)
    forward = steps[steps > 0]
    if not len(forward):
        raise LogError("Time does not run forwards anywhere.")
    repeated = float((steps == 0).mean())
    if repeated > 0.5:
        raise LogError(
            f"{repeated:.0%} of the time stamps repeat the one before: they are too coarse for the "
            "samples. Give the sampling time in seconds with --Ts."
        )
    Ts = float(np.median(forward))
    if not pace.fastest <= Ts <= pace.slowest:
        raise LogError(
            f"The sampling time is {Ts:g} s; it must lie between {pace.fastest:g} and "
            f"{pace.slowest:g} s. If the time is not in seconds, give --time-unit."
        )
    longest = max(1.5 * Ts, min(3.5 * Ts, pace.bridged))
    breaks = np.flatnonzero((steps <= 0) | (steps > longest))
    ends = np.concatenate([[0], breaks + 1, [len(time)]])
    spans = np.array([time[j - 1] - time[i] for i, j in zip(ends, ends[1:], strict=False)])
    best = 0 if from_first else int(np.argmax(spans))
    notes: tuple[str, ...] = ()
    if len(breaks):
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
        notes = (f"{where}: {used} is used.",)
    rows = slice(int(ends[best]), int(ends[best + 1]))
    return _grid(time, rows, notes)


def _grid(time: Array, rows: slice, notes: tuple[str, ...]) -> TimeBase:
    """Least squares through the stamps, after counting how many samples each step spans."""
    t = time[rows]
    steps = np.diff(t)
    spans = np.maximum(1, np.rint(steps / np.median(steps)))
    count = np.concatenate([[0.0], np.cumsum(spans)])
    offset, slope = (float(c) for c in np.polynomial.polynomial.polyfit(count, t - t[0], 1))
    Ts = _rounded(slope)
    off = float(np.abs(t - t[0] - offset - count * slope).max())
    lost = int(spans.sum()) - len(spans)
    grid = t[0] + Ts * np.arange(int(count[-1]) + 1)
    if off <= EVEN * Ts and not lost:
        return TimeBase(rows, grid, Ts, True, notes)
    found = [f"Time stamps are off an even grid by up to {1e3 * off:.3g} ms"] * (off > EVEN * Ts)
    found += [f"{lost} sample{'s' * (lost > 1)} lost"] * (lost > 0)
    words = f"{', '.join(found)}: resampled to {1e3 * Ts:.5g} ms."
    return TimeBase(rows, grid[grid <= t[-1]], Ts, False, (*notes, words))


def _rounded(Ts: float) -> float:
    """Without the noise of the stamps: 0.0100000003 s is 0.01 s."""
    close = float(f"{Ts:.4g}")
    return close if abs(close / Ts - 1) < 1e-5 else Ts


def _break(time: Array, k: int) -> str:
    step = time[k + 1] - time[k]
    what = f"A gap of {step:.3g} s" if step > 0 else "Time stands still or runs backwards"
    return f"{what} at t = {time[k]:.6g} s (sample {k + 2})"
