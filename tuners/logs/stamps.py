"""Time stamps as loggers write them: epochs, wrapped counters, jitter.

Stamps that jitter about an even line belong to samples that were taken evenly and stamped late,
or to samples that were taken when the stamps say.  The output decides: with e_k the stamp's
distance from the line, it differs from its neighbours' mean by e_k y'_k in the second case, and
by nothing that goes with e_k in the first (`taken_when_stamped`).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.logs.table import Array

_EPOCHS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_CLOSE = 5e8, 5e9  # s since 1970: from 1985 to 2128

_POWERS = [2.0**k for k in range(8, 49)] + [10.0**k for k in range(2, 13)]
_CLOCKS = [60.0, 3600.0, 43200.0, 86400.0, 604800.0]  # the last is a week of GPS
_SCALES = 1.0, 1e3, 1e6, 1e9

_BLOCKS = 10  # over which jitter must average out
_DRIFT = 0.25  # of the sampling time
_MOST = 20.0  # sampling times of jitter
_NEAR = 8  # stamps on either side of a loss
_ROUNDS = 50  # in which losses are found
_CERTAIN = 3.0  # standard errors


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """Even samples behind time stamps.

    Attributes
    ----------
    count : NDArray
        (N,) number of each sample, from 0.
    start, Ts : float
        [s].
    off : NDArray
        (N,) how late each stamp is [s].
    """

    count: Array
    start: float
    Ts: float
    off: Array

    @property
    def jitter(self) -> float:
        """The largest distance of a stamp [s]."""
        return float(np.abs(self.off).max())

    @property
    def lost(self) -> int:
        """How many samples are missing."""
        return int(self.count[-1]) + 1 - len(self.count)


def epoch_unit(values: Array) -> tuple[str, tuple[str, ...]]:
    """The unit of times since 1970, where they are so large that they must be; and a note."""
    known = values[np.isfinite(values)]
    middle = float(np.median(known)) if len(known) else 0.0
    for unit, factor in _EPOCHS.items():
        if middle > _CLOSE[1] and _CLOSE[0] < middle * factor < _CLOSE[1]:
            return unit, (f"Time was taken as {unit} since 1970.",)
    return "", ()


def unwrapped(time: Array) -> tuple[Array, tuple[str, ...]]:
    """Time stamps (N,) of a counter that began again at 0, in one run; and a note."""
    steps = np.diff(time)
    back = steps < 0
    if not back.any() or time.min() < 0 or not (steps > 0).any():
        return time, ()
    Ts = float(np.median(steps[steps > 0]))
    spans = Ts - steps[back]
    for scale in _SCALES:
        for modulus in _POWERS + (_CLOCKS if scale <= 1e3 else []):
            wrap = modulus * (1.0 if modulus in _CLOCKS else 1 / scale)
            near = np.abs(spans - wrap) <= 0.75 * Ts
            if near.all() and time.max() < wrap and wrap > 20 * Ts:
                note = f"The time stamps began again at 0 after {wrap:.10g} s: joined."
                return time + wrap * np.concatenate([[0.0], np.cumsum(back)]), (note,)
    return time, ()


def order(time: Array) -> NDArray[np.intp] | None:
    """The order in time of rows (N,) that came shuffled by a few; None where that is not so."""
    ranks = np.argsort(time, kind="stable")
    moved = np.abs(ranks - np.arange(len(time))).max(initial=0)
    return ranks if 0 < moved <= _MOST and (np.diff(time[ranks]) > 0).all() else None


def line(time: Array) -> Line | None:
    """Even samples without a loss behind stamps (N,), where jitter is all that they have."""
    found = _fitted(time, np.arange(len(time), dtype=np.float64))
    backwards = bool((np.diff(time) < 0).any())
    if backwards or found.jitter > min(_MOST, len(time) / 100) * found.Ts:
        return None
    blocks = [block.mean() for block in np.array_split(found.off, _BLOCKS)]
    return found if np.abs(blocks).max() <= _DRIFT * found.Ts else None


def line_with_losses(time: Array) -> Line:
    """Even samples, some of them lost, behind stamps (N,): after a loss stamps stay late."""
    apart = min(50, len(time) // 4)
    Ts = float(np.median(time[apart:] - time[:-apart])) / apart
    spans = np.ones(len(time) - 1)
    for _ in range(_ROUNDS):
        closed = time - Ts * np.concatenate([[0.0], np.cumsum(spans - 1)])
        long = np.flatnonzero(np.diff(closed) > 1.5 * Ts)
        lost = np.rint(_jumps(closed, long, Ts) / Ts - 1)
        # Of losses that seem near each other, the larger blurs the others.
        largest = lost > 0
        for k in range(1, min(_NEAR, len(long) - 1) + 1):
            near = long[k:] - long[:-k] <= _NEAR
            largest[:-k] &= ~near | (lost[:-k] >= lost[k:])
            largest[k:] &= ~near | (lost[k:] >= lost[:-k])
        chosen = np.flatnonzero(largest)
        chosen = chosen[np.diff(long[chosen], prepend=-2 * _NEAR) > _NEAR]
        if not len(chosen):
            break
        spans[long[chosen]] += lost[chosen]
    return counted(time, spans)


def _jumps(time: Array, at: NDArray[np.intp], Ts: float) -> Array:
    """By how much stamps are later after rows (K,) than before, in the median of a few [s]."""
    offsets = np.arange(_NEAR)
    back, forth = at[:, None] - offsets, at[:, None] + 1 + offsets
    before = np.where(back >= 0, time[np.maximum(back, 0)], np.nan) + offsets * Ts
    last = len(time) - 1
    after = np.where(forth <= last, time[np.minimum(forth, last)], np.nan) - offsets * Ts
    return np.asarray(np.nanmedian(after, axis=1) - np.nanmedian(before, axis=1))


def counted(time: Array, spans: Array) -> Line:
    """Even samples behind stamps (N,) whose steps span these many sampling times (N - 1,)."""
    return _fitted(time, np.concatenate([[0.0], np.cumsum(spans)]))


def taken_when_stamped(found: Line, y: Array) -> bool:
    """Whether the output shows that samples were taken when they were stamped."""
    slope = np.gradient(y, found.count * found.Ts)
    expected, seen = (x[1:-1] - (x[:-2] + x[2:]) / 2 for x in (found.off * slope, y))
    power = float(expected @ expected)
    if power == 0.0:
        return False
    share = float(seen @ expected) / power
    error = float(np.sqrt(np.mean((seen - share * expected) ** 2) / power))
    return share > 0.5 and share > _CERTAIN * error


def _fitted(time: Array, count: Array) -> Line:
    offset, slope = (float(c) for c in np.polynomial.polynomial.polyfit(count, time - time[0], 1))
    off = time - time[0] - offset - slope * count
    return Line(count, float(time[0] + offset), slope, off)
