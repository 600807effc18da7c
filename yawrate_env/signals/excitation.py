"""Pseudo-random binary excitation from maximum-length shift registers.

The register is the linear-feedback one of Golomb, *Shift Register Sequences*, with the
taps and the bit order of ``scipy.signal.max_len_seq`` (which is not imported: it
costs seconds of start-up, and the recurrence is one line).
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

_TAPS = {
    3: (2,), 4: (3,), 5: (3,), 6: (5,), 7: (6,), 8: (7, 6, 1), 9: (5,), 10: (7,), 11: (9,),
    12: (11, 10, 4), 13: (12, 11, 8), 14: (13, 12, 2), 15: (14,), 16: (15, 13, 4),
}  # fmt: skip
SAME_ORDER = 7
RANDOM_ORDER = 14


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
        Length of the register, 3 to 16.
    start : (E,) uint64, optional
        Where in the period each of E sequences starts (taken modulo the period).

    Returns
    -------
    (E, N) float64
        E = 1 without `start`.
    """
    period = register(order)
    # The small shift keeps k Ts / bit_time from falling just short of a whole number.
    bit = np.floor(np.arange(N) * Ts / bit_time + 1e-9).astype(np.int64)
    starts = np.zeros(1, dtype=np.int64) if start is None else (start % len(period)).astype(int)
    bits = period[(starts[:, None] + bit) % len(period)]
    return np.asarray(amplitude * (2.0 * bits - 1.0))
