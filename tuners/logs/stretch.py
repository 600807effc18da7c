"""The part of a long recording that is used: well excited, steady, and of the tuner's range."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.logs.columns import channels
from tuners.logs.excitation import band_of, in_band, windowed
from tuners.logs.options import Options
from tuners.logs.table import Array, SelectionError
from tuners.logs.time_base import TimeBase
from tuners.tuner.recording import STEADY, UNSTEADY
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant

LONGEST = 2.0
"""How much of a recording is used, unless a stretch is chosen, in lengths of the experiment."""

_POINTS = 1000  # of a drawn recording
_ENOUGH = 0.25  # of the best stretch's power, for another to be worth tuning from
_SPREAD = 1.2  # between the means of a parameter, for gains to be worth scheduling over it


@dataclass(frozen=True, slots=True, eq=False)
class Whole:
    """A whole recording, thinned out to be drawn, and which part of it is used.

    Attributes
    ----------
    time : NDArray
        (M,) [s].
    inputs : NDArray
        (m, M, 2) least and largest of each input between two of these times.
    measured : dict
        Measured parameters (M,).
    used : tuple of float
        Begin and end of the part that is used [s].
    """

    time: Array
    inputs: Array
    measured: dict[str, Array]
    used: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """The part of a recording that is used, notes on it, and the whole where it is longer."""

    part: slice
    notes: tuple[str, ...] = ()
    whole: Whole | None = None


def choose(base: TimeBase, signals: Mapping[str, Array], plant: Plant, options: Options) -> Stretch:
    """The user's stretch or the best; a plant that starts at rest is used from its start."""
    measured = {name: signals[name] for name in plant.measured if name in signals}
    u = np.stack([signals[key] for key in channels(plant, "input")])
    if options.start is not None or options.stop is not None:
        part = between(base.grid, options.start, options.stop)
        return Stretch(part, (), _whole(base, u, measured, part))
    everything = slice(0, len(base.grid))
    samples = round(LONGEST * plant.samples * plant.Ts / base.Ts)
    if not anytime(plant) or u.shape[1] <= samples:
        return Stretch(everything)
    power, steady, within = _judged(u, measured, base.Ts, plant, samples)
    part = best(power, steady, within, samples)
    first, last = base.grid[[part.start, part.stop - 1]]
    means = "".join(
        f", {_called(plant, name)} {values[part].mean():.3g}" for name, values in measured.items()
    )
    notes = [f"Best-excited stretch used: {first:.2f} to {last:.2f} s{means}."]
    if not within.any():
        notes.append("No stretch lies within the range that the tuner was made for.")
    good = steady & within & (power >= _ENOUGH * power[part.start])
    notes += [
        words
        for name, values in measured.items()
        if (words := _several(plant, name, windowed(values, samples)[good]))
    ]
    return Stretch(part, tuple(notes), _whole(base, u, measured, part))


def anytime(plant: Plant) -> bool:
    """Whether a recording may begin in any state of the plant."""
    return plant.linear or bool(plant.initial)


def best(power: Array, steady: NDArray[np.bool_], within: NDArray[np.bool_], samples: int) -> slice:
    """The `samples` of most power among those that are steady and within range, or one of these."""
    allowed = next((a for a in (steady & within, within, steady) if a.any()), ~steady)
    start = int(np.argmax(np.where(allowed, power, -1.0)))
    return slice(start, start + samples)


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


def _judged(
    u: Array, measured: Mapping[str, Array], Ts: float, plant: Plant, samples: int
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Power of every stretch, and whether measured parameters are steady and in the prior.

    Of several inputs (m, N) that counts which has the least, over the experiment's.
    """
    planned = np.ptp(np.atleast_2d(plant.u), axis=1)
    power = np.min(
        [_power(row, Ts, plant, samples) / size**2 for row, size in zip(u, planned, strict=True)],
        axis=0,
    )
    steady, within = np.ones((2, len(power)), dtype=np.bool_)
    for name, values in measured.items():
        mean, slack = windowed(values, samples), plant.measured[name]
        low, high = plant.prior[name]
        steady &= _variance(values, samples) < (STEADY / 2 * mean) ** 2
        steady &= _range(values, samples) < UNSTEADY * np.abs(mean)
        within &= (mean >= low - slack) & (mean <= high + slack)
    return power, steady, within


def _power(u: Array, Ts: float, plant: Plant, samples: int) -> Array:
    """Power of every stretch of an input (N,), around the crossover where the plant has one."""
    moving, band = u - u.mean(), band_of(plant)
    return _variance(moving if band is None else in_band(moving, Ts, band), samples)


def _several(plant: Plant, name: str, means: Array) -> str:
    """A hint where good stretches differ in a parameter."""
    if not len(means) or means.min() <= 0 or means.max() < _SPREAD * means.min():
        return ""
    words, unit = split(plant.label(name))
    return (
        f"Good stretches cover {words} from {means.min():.3g} to {means.max():.3g} {unit}".rstrip()
        + f": gains over {words} are possible, tuned from these apart (--from, --to)."
    )


def _called(plant: Plant, name: str) -> str:
    return split(plant.label(name))[0]


def _whole(base: TimeBase, u: Array, measured: Mapping[str, Array], part: slice) -> Whole:
    count = min(_POINTS, u.shape[1])
    starts = np.linspace(0, u.shape[1], count, endpoint=False).astype(np.intp)
    least, largest = (end.reduceat(u, starts, axis=1) for end in (np.minimum, np.maximum))
    ends = np.stack([least, largest], axis=2)
    thin = {name: values[starts] for name, values in measured.items()}
    first, last = base.grid[[part.start, part.stop - 1]]
    return Whole(base.grid[starts], ends, thin, (float(first), float(last)))


def _range(x: Array, samples: int) -> Array:
    """Running differences of the largest and the least of `samples`."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    first = samples // 2  # where a filter's window begins with the first value
    spans = maximum_filter1d(x, samples) - minimum_filter1d(x, samples)
    return np.asarray(spans[first : first + len(x) - samples + 1])


def _variance(x: Array, samples: int) -> Array:
    """Running variances over `samples`."""
    x = x - x.mean()
    return np.asarray(windowed(x**2, samples) - windowed(x, samples) ** 2)
