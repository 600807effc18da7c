"""Checks of a recording's excitation before it is tuned from.

The input's power around the crossover, which determines the controller, is compared with that of
the plant's experiment.  Recordings without information are refused; weak excitation is noted, and
the tuner's intervals show its cost.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tuners.logs.table import Array, LogError
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant

Band = tuple[float, float]

SHORTEST = 0.3
"""Duration that is needed, in lengths of the experiment."""

_WEAK_RMS, _NO_RMS = 0.1, 0.002  # of the experiment's amplitude
_STILL = 1e-9  # peak to peak, of the largest absolute value
_FEW = 4  # changes of the input


@dataclass(frozen=True, slots=True)
class Excitation:
    """How a recording excites the plant.

    Attributes
    ----------
    duration : float
        [s].
    amplitudes : tuple of float
        Half the peak-to-peak value of each input.
    band : tuple of float or None
        Frequencies looked at [Hz]; None where the plant has no crossover.
    rms : float
        Of the input within the band.
    changes : int
        How often the input crosses its middle.
    notes : tuple of str
        What is weak about it, in words.
    """

    duration: float
    amplitudes: tuple[float, ...]
    band: Band | None
    rms: float
    changes: int
    notes: tuple[str, ...]

    @property
    def amplitude(self) -> float:
        """Half the peak-to-peak value of the first input."""
        return self.amplitudes[0]


def band_of(plant: Plant) -> Band | None:
    """A third to three and a third times the crossover: 0.5 to 5 Hz for 1.5 Hz."""
    return None if plant.crossover is None else (plant.crossover / 3, plant.crossover * 10 / 3)


def in_band(x: Array, Ts: float, band: Band) -> Array:
    """Part of a signal (N,) within a band [Hz]."""
    spectrum = np.fft.rfft(x)
    frequency = np.fft.rfftfreq(len(x), Ts)
    spectrum[(frequency < band[0]) | (frequency > band[1])] = 0
    return np.fft.irfft(spectrum, len(x))


def rms_in_band(x: Array, Ts: float, band: Band | None) -> float:
    """Root mean square within a band; a squared Hann window keeps slow drift out of it."""
    if band is None:
        return float(x.std())
    window = np.hanning(len(x)) ** 2
    part = in_band(window * (x - x.mean()), Ts, band)
    return float(np.sqrt(np.mean(part**2) / np.mean(window**2)))


def check(plant: Plant, u: Array, y: Array, measured: Mapping[str, Array], Ts: float) -> Excitation:
    """Measure the excitation; `LogError` where nothing can be learned.

    Of several inputs (m, N) each must move, and band, power and
    changes are the first's.
    """
    _check_length(plant, u.shape[-1] * Ts)
    planned, rows = np.atleast_2d(plant.u), np.atleast_2d(u)
    for signal, given, own in zip(plant.inputs_named, rows, planned, strict=True):
        _check_input(signal, given, own)
    for signal, given in zip(plant.outputs_named, np.atleast_2d(y), strict=True):
        if _still(given):
            raise LogError(f"{signal} is constant ({given[0]:.3g}): is it the right column?")
    _check_plausible(plant, u, y)
    found = [
        _described(plant, *each, Ts) for each in zip(plant.inputs_named, rows, planned, strict=True)
    ]
    notes = [note for each in found for note in each.notes]
    if plant.remarks is not None:
        notes += plant.remarks(u, y, measured)
    return replace(found[0], amplitudes=tuple(each.amplitude for each in found), notes=tuple(notes))


def _described(plant: Plant, signal: str, u: Array, planned: Array, Ts: float) -> Excitation:
    """How one input (N,) excites the plant."""
    band, (name, unit) = band_of(plant), split(signal)
    amplitude, expected = np.ptp(u) / 2, np.ptp(planned) / 2
    rms = rms_in_band(u, Ts, band)
    within = f" between {band[0]:.2g} and {band[1]:.2g} Hz" if band else ""
    found = f"{rms:.2g} {unit} rms".replace("  ", " ")
    if rms < _NO_RMS * expected:
        raise LogError(
            f"{name} hardly moves{within} ({found}): nothing can be learned about the crossover. "
            "Record the experiment's input, which `yawrate excite` writes."
        )
    changes, notes = _changes(u), []
    if rms < _WEAK_RMS * expected:
        notes.append(f"Weak excitation: {found}{within}.")
    if changes < min(_FEW, _changes(planned)):
        notes.append(f"Little excitation: {name} crosses its middle {_times(changes)}.")
    return Excitation(len(u) * Ts, (float(amplitude),), band, rms, changes, tuple(notes))


def _check_length(plant: Plant, duration: float) -> None:
    least = SHORTEST * plant.samples * plant.Ts
    if duration < least:
        raise LogError(f"{duration:.2f} s are too short; at least {least:g} s are needed.")


def _check_input(signal: str, u: Array, planned: Array) -> None:
    """Refuse what can tell nothing; a constant input is a step if that is the experiment."""
    if _still(u) and (u[0] == 0 or not _still(planned)):
        raise LogError(f"{signal} is constant ({u[0]:.3g}): nothing moves.")


def _check_plausible(plant: Plant, u: Array, y: Array) -> None:
    """Refuse what the plant never does: mostly, a unit is not the assumed one."""
    for role, values, signal, largest in zip(
        ("input", "output"), (u, y), plant.signals, plant.plausible, strict=True
    ):
        name, unit = split(signal)
        reached = float(np.abs(values).max())
        if reached > largest:
            raise LogError(
                f"{name} reaches {reached:.3g} {unit}, at most {largest:.3g} is plausible. "
                f"Give --{role}-unit or --{role}-scale."
            )


def _still(x: Array) -> bool:
    return bool(np.ptp(x) <= _STILL * np.abs(x).max())


def _changes(u: Array) -> int:
    return int(np.count_nonzero(np.diff(u > (u.max() + u.min()) / 2)))


def windowed(x: Array, samples: int) -> Array:
    """Running means over `samples`."""
    sums = np.concatenate([[0.0], np.cumsum(x)])
    return np.asarray((sums[samples:] - sums[:-samples]) / samples)


def _times(count: int) -> str:
    return ("never", "only once", "only twice")[count] if count < 3 else f"only {count} times"
