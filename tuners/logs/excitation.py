"""Whether a recording can tell anything, before anything is tuned from it.

What matters is the command's power around the wanted crossover, where the controller will
be decided.  Refused is what is hopeless; what is merely weak is said, and the tuner's
intervals show what it costs.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tuners.logs.table import Array, LogError
from yawrate_env.vehicle.plausible import (
    LARGEST_ANGLE,
    LARGEST_SPEED,
    LARGEST_YAW_RATE,
    STEADY,
    STILL,
    UNSTEADY,
)

Band = tuple[float, float]

SHORTEST = 3.0
_WEAK_RMS, _NO_RMS = np.radians(0.1), np.radians(0.002)
_LINEAR = 4.0  # [m/s^2] of lateral acceleration, beyond which tyres saturate on dry asphalt


@dataclass(frozen=True, slots=True)
class Excitation:
    """How a recording excites the vehicle.

    Attributes
    ----------
    duration : float
        [s].
    amplitude : float
        Half the peak-to-peak command [rad].
    band : tuple of float
        Frequencies looked at [Hz].
    rms : float
        Of the command within the band [rad].
    changes : int
        How often the command crosses its mean.
    notes : tuple of str
        What is weak about it, in words.
    """

    duration: float
    amplitude: float
    band: tuple[float, float]
    rms: float
    changes: int
    notes: tuple[str, ...]


def band_around(crossover: float) -> Band:
    """A third to three and a third times the crossover: 0.5 to 5 Hz for 1.5 Hz."""
    return crossover / 3, crossover * 10 / 3


def in_band(x: Array, Ts: float, band: Band) -> Array:
    """Part of a signal (N,) within a band [Hz]."""
    spectrum = np.fft.rfft(x)
    frequency = np.fft.rfftfreq(len(x), Ts)
    spectrum[(frequency < band[0]) | (frequency > band[1])] = 0
    return np.fft.irfft(spectrum, len(x))


def rms_in_band(x: Array, Ts: float, band: Band) -> float:
    """Root mean square within a band; a squared Hann window keeps slow drift out of it."""
    window = np.hanning(len(x)) ** 2
    part = in_band(window * (x - x.mean()), Ts, band)
    return float(np.sqrt(np.mean(part**2) / np.mean(window**2)))


def check(steer: Array, yaw_rate: Array, speed: Array, Ts: float, crossover: float) -> Excitation:
    """Measure the excitation; `LogError` where nothing can be learned."""
    duration, amplitude = len(steer) * Ts, float(np.ptp(steer)) / 2
    if duration < SHORTEST:
        raise LogError(f"{duration:.2f} s are too short; at least {SHORTEST:g} s are needed.")
    if not np.ptp(steer) > STILL:
        raise LogError(f"The steering is constant ({np.degrees(steer[0]):.3g} deg): nothing moves.")
    if not np.ptp(yaw_rate) > STILL:
        raise LogError(f"The yaw rate is constant ({yaw_rate[0]:.3g} rad/s): is it the right one?")
    _plausible(steer, yaw_rate, speed)
    band = band_around(crossover)
    rms = rms_in_band(steer, Ts, band)
    within = f"between {band[0]:.2g} and {band[1]:.2g} Hz"
    if rms < _NO_RMS:
        raise LogError(
            f"The steering hardly moves {within} ({np.degrees(rms):.2g} deg rms): "
            "nothing can be learned about the crossover. Drive `yawrate excite`'s signal."
        )
    centred = steer > (steer.max() + steer.min()) / 2
    changes = int(np.count_nonzero(np.diff(centred)))
    notes = []
    if rms < _WEAK_RMS:
        notes.append(f"Weak excitation: {np.degrees(rms):.2g} deg rms {within}.")
    if changes < 4:
        notes.append(f"Little excitation: the steering crosses its middle {_times(changes)}.")
    lateral = float(np.abs(yaw_rate * speed).max())
    if lateral > _LINEAR:
        notes.append(
            f"Lateral acceleration reaches {lateral:.1f} m/s^2, where tyres are no longer linear."
        )
    return Excitation(duration, amplitude, band, rms, changes, tuple(notes))


def _plausible(steer: Array, yaw_rate: Array, speed: Array) -> None:
    """Refuse what no car does: a unit that is not the assumed one."""
    angle, turn = np.degrees(np.abs(steer).max()), np.abs(yaw_rate).max()
    if angle > np.degrees(LARGEST_ANGLE):
        raise LogError(
            f"The steering reaches {angle:.3g} deg at the road wheel. "
            "Give --steer-unit, or the --steer-ratio of the hand wheel."
        )
    if turn > LARGEST_YAW_RATE:
        raise LogError(f"The yaw rate reaches {turn:.3g} rad/s. Give --yaw-rate-unit.")
    if not 0 < speed.min() <= speed.max() <= LARGEST_SPEED:
        raise LogError(
            f"The speed runs from {speed.min():.3g} to {speed.max():.3g} m/s. "
            "Give --speed-unit, or choose a stretch with --from and --to."
        )
    if np.ptp(speed) > UNSTEADY * speed.mean():
        raise LogError(
            f"The speed varies from {speed.min():.3g} to {speed.max():.3g} m/s, more than "
            f"{UNSTEADY:.0%} of its mean. Choose a steadier stretch with --from and --to."
        )


def best_stretch(
    u: Array, beside: Sequence[Array], Ts: float, band: Band | None, length: float
) -> tuple[slice, bool]:
    """The `length` [s] of most power, and whether it is less than everything.

    Where there is a stretch over which all that is measured beside the input stays within
    5 %, only such are considered.

    Parameters
    ----------
    u : (N,) float64
        Input.
    beside : sequence of (N,) float64
        A speed, say.
    band : tuple of float or None
        Where its power counts [Hz]; None counts all that varies.
    """
    samples = round(length / Ts)
    if len(u) <= samples:
        return slice(0, len(u)), False
    moving = u - u.mean()
    if band is not None:
        moving = in_band(moving, Ts, band)
    power = _variance(moving, samples)
    allowed = np.ones(len(power), dtype=np.bool_)
    for values in beside:
        allowed &= _variance(values, samples) < (STEADY / 2 * _windowed(values, samples)) ** 2
    start = int(np.argmax(np.where(allowed, power, -1.0) if allowed.any() else power))
    return slice(start, start + samples), True


def _variance(x: Array, samples: int) -> Array:
    """Running variances over `samples`."""
    return np.asarray(_windowed(x**2, samples) - _windowed(x, samples) ** 2)


def _windowed(x: Array, samples: int) -> Array:
    """Running means over `samples`."""
    sums = np.concatenate([[0.0], np.cumsum(x)])
    return np.asarray((sums[samples:] - sums[:-samples]) / samples)


def _times(count: int) -> str:
    return ("never", "only once", "only twice")[count] if count < 3 else f"only {count} times"
