"""Inputs of experiments: two or more levels from maximum-length shift registers, and multisines.

The register is the linear-feedback one of Golomb, *Shift Register Sequences*, with the
taps and the bit order of ``scipy.signal.max_len_seq`` (which is not imported: it
costs seconds of start-up, and the recurrence is one line).

=============  ===================================================================================
kind           what it shows
=============  ===================================================================================
``prbs``       of two levels the most power for an amplitude; nothing of what lies between or beyond
``levels``     an actuator's saturation, its characteristic and its friction, for less power
``multisine``  the same, with all its power below one frequency and none beyond
=============  ===================================================================================
"""

from functools import cache
from math import gcd

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation

_TAPS = {
    2: (1,), 3: (2,), 4: (3,), 5: (3,), 6: (5,), 7: (6,), 8: (7, 6, 1), 9: (5,), 10: (7,), 11: (9,),
    12: (11, 10, 4), 13: (12, 11, 8), 14: (13, 12, 2), 15: (14,), 16: (15, 13, 4),
    17: (14,), 18: (11,), 19: (18, 17, 14), 20: (17,),
}  # fmt: skip
SAME_ORDER = 7
RANDOM_ORDER = 14
_BAND = 0.44  # of a bit's frequency: where the spectrum of held bits has fallen to half


@cache
def register(order: int) -> NDArray[np.int8]:
    """One period, (2**order - 1,) of 0 and 1, from the all-ones state."""
    if order not in _TAPS:
        raise ValueError(
            f"order = {order!r} must be a whole number from {min(_TAPS)} to {max(_TAPS)}. Choose "
            "one: a register repeats after 2^order - 1 bits."
        )
    state = [1] * order
    bits = np.empty(2**order - 1, dtype=np.int8)
    for i in range(len(bits)):
        bits[i] = state[0]
        feedback = state[0]
        for tap in _TAPS[order]:
            feedback ^= state[tap]
        state = [*state[1:], feedback]
    bits.setflags(write=False)
    return bits


def prbs(
    N: int,
    Ts: float,
    bit_time: float,
    amplitude: float,
    *,
    order: int = SAME_ORDER,
    start: NDArray[np.uint64] | None = None,
) -> NDArray[np.float64]:
    """Hold the register's bits for `bit_time` each, as -amplitude and +amplitude.

    Parameters
    ----------
    N : int
        Samples.
    Ts, bit_time : float
        Sampling time and time a bit is held [s]; episodes longer than a period repeat it.
    amplitude : float
        Half the peak-to-peak value, in the unit of the output.
    order : int
        Length of the register, 2 to 20.
    start : (E,) uint64, optional
        Where in the period each of E sequences starts (taken modulo the period).

    Returns
    -------
    (E, N) float64
        E = 1 without `start`.
    """
    period = register(order)
    bits = period[_places(N, Ts, bit_time, start, len(period))]
    return np.asarray(amplitude * (2.0 * bits - 1.0))


def multilevel(
    N: int,
    Ts: float,
    bit_time: float,
    amplitude: float,
    levels: int,
    *,
    order: int = RANDOM_ORDER,
    start: NDArray[np.uint64] | None = None,
) -> NDArray[np.float64]:
    """Hold levels from -amplitude to amplitude, evenly spaced, for `bit_time` each.

    The register's state, a number from 1 to ``2**order - 1`` that takes each value once in a
    period, chooses the level; it is read every `order` bits or a little more, so that states do not
    overlap before the register has come round, which takes ``2**order / order`` levels.

    Parameters
    ----------
    levels : int
        Two or more, fewer than the register has states.

    Returns
    -------
    (E, N) float64
        As `prbs`, whose parameters the others are.
    """
    states = len(register(order))
    remedy = "Give two or more; a register of a higher order tells more levels apart."
    validation.count("levels", levels, at_least=2, at_most=states, remedy=remedy)
    sequence = _states(order) * levels // (states + 1)
    chosen = sequence[_places(N, Ts, bit_time, start, states)]
    return np.asarray(amplitude * (2.0 * chosen / (levels - 1) - 1.0))


def multisine(
    N: int,
    Ts: float,
    bit_time: float,
    amplitude: float,
    *,
    start: NDArray[np.uint64] | None = None,
) -> NDArray[np.float64]:
    """Equal sines at every multiple of ``1/(N Ts)`` up to ``0.44/bit_time``, phased to stay small.

    There the spectrum of a binary sequence of this bit time has fallen to half.  The phases
    are Schroeder's (1970), ``-pi k (k - 1)/K`` for the k-th of K sines.

    Parameters
    ----------
    amplitude : float
        Largest absolute value.
    start : (E,) uint64, optional
        Sample at which each of E episodes starts (taken modulo N): the sum of sines is periodic.

    Returns
    -------
    (E, N) float64
        As `prbs`, whose parameters the others are.
    """
    highest = int(min(_BAND / bit_time, 0.5 / Ts) * N * Ts + 1e-9)
    if highest < 1:
        raise ValueError(
            f"bit_time = {bit_time:g} s leaves no sine in {N * Ts:g} s. Choose a shorter one, at "
            f"most {_BAND * N * Ts:.4g} s, or record for longer."
        )
    k = np.arange(1, highest + 1)
    spectrum = np.zeros(N // 2 + 1, dtype=np.complex128)
    spectrum[k] = np.exp(-1j * np.pi * k * (k - 1) / highest)
    whole = np.fft.irfft(spectrum, N)
    whole *= amplitude / np.abs(whole).max()
    starts = np.zeros(1, dtype=np.int64) if start is None else (start % N).astype(int)
    return np.asarray(whole[(starts[:, None] + np.arange(N)) % N])


def _places(
    N: int, Ts: float, bit_time: float, start: NDArray[np.uint64] | None, period: int
) -> NDArray[np.int64]:
    """Where in a period each sample of episodes (E, N) is."""
    # The small shift keeps k Ts / bit_time from falling just short of a whole number.
    bit = np.floor(np.arange(N) * Ts / bit_time + 1e-9).astype(np.int64)
    starts = np.zeros(1, dtype=np.int64) if start is None else (start % period).astype(np.int64)
    return np.asarray((starts[:, None] + bit) % period)


@cache
def _states(order: int) -> NDArray[np.int64]:
    """States of the register, a number of `order` bits each, in steps that do not overlap."""
    bits = register(order).astype(np.int64)
    period = len(bits)
    step = next(s for s in range(order, 2 * period) if gcd(s, period) == 1)
    first = step * np.arange(period) % period
    return np.asarray(sum(bits[(first + i) % period] << i for i in range(order)))
