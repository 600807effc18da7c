"""Margins of open loops ``L = C G z^-d``, batched.

A compiled loop evaluates the ratios of polynomials in ``delta = (z - 1)/Ts`` on a frequency grid;
the crossings found there are refined to machine precision by the Illinois rule (Dowell and
Jarratt, 1971), in a tenth of the evaluations that bisection needs.
"""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import kernel, over_blocks, subkernel
from yawrate_env.loop.transfer_function import TransferFunction, delta_operator

_BLOCK = 64
_REFINEMENTS = 60  # seven or eight do; bisection would need all of them
_SECTIONS = 35  # a fifteen-millionth of an interval is left, and the square of that of the value
_GOLDEN = 0.6180339887498949


@dataclass(frozen=True, slots=True, eq=False)
class Margins:
    """Margins of B loops; ``nan`` where a crossing does not exist.

    Attributes
    ----------
    phase_margin : NDArray
        At `crossover`, between -180 and 180 [deg].
    crossover : NDArray
        Where the loop's magnitude falls through 1 for good [Hz].
    gain_margin : NDArray
        At `phase_crossover` [dB].
    phase_crossover : NDArray
        The crossing of the negative real axis nearest to magnitude 1 [Hz].
    modulus_margin : NDArray
        Least distance of the loop from -1.
    delay_margin : NDArray
        Delay that takes up the phase margin [s].
    """

    phase_margin: NDArray[np.float64]
    crossover: NDArray[np.float64]
    gain_margin: NDArray[np.float64]
    phase_crossover: NDArray[np.float64]
    modulus_margin: NDArray[np.float64]
    delay_margin: NDArray[np.float64]


def margins(loop: TransferFunction) -> Margins:
    """Margins of each loop.

    Crossover, phase crossover and the distance from -1 are looked for on a grid (64
    points a decade over the last 3.5 decades below the Nyquist frequency, 8 a decade
    for six decades below that) and refined between its points, so a resonance of
    damping ratio below 0.02 could hide a crossing.
    """
    delays = np.broadcast_to(loop.delay_samples, len(loop.num))
    found = np.empty((len(loop.num), 6))
    for delay in np.unique(delays):
        rows = delays == delay
        found[rows] = _with_delay(loop.num[rows], loop.den[rows], loop.Ts, int(delay))
    return Margins(*found.T.copy())


def _with_delay(
    num: NDArray[np.float64], den: NDArray[np.float64], Ts: float, delay: int
) -> NDArray[np.float64]:
    """Margins (B, 6) of loops with the same delay."""
    grid = _grid(Ts, delay)
    num, den = np.ascontiguousarray(num), np.ascontiguousarray(den)
    found = np.empty((len(num), 6))

    def some(i: int, j: int) -> None:
        _margins(num[i:j], den[i:j], Ts, delay, grid, np.empty((6, grid.shape[1])), found[i:j])

    over_blocks(some, len(num), _BLOCK)
    return found


@cache
def _grid(Ts: float, delay_samples: int) -> NDArray[np.float64]:
    """Frequencies [rad/s], their delta and the delay's response, real and imaginary, (5, F)."""
    omega = np.concatenate([np.logspace(-9.5, -3.5, 48, False), np.logspace(-3.5, 0, 225)])
    omega *= np.pi / Ts
    delta = delta_operator(omega, Ts)
    lag = np.exp(-1j * delay_samples * Ts * omega)
    return np.stack([omega, delta.real, delta.imag, lag.real, lag.imag])


# The kernels below work on real numbers and with the functions of `math`: complex numbers, and
# NumPy's, take Numba twice as long to compile, which is much of the time to a first answer.


@subkernel
def _squared(real: float, imag: float) -> float:
    return real * real + imag * imag


@subkernel
def _at(
    num: NDArray[np.float64], den: NDArray[np.float64], b: int, Ts: float, delay: int, omega: float
) -> tuple[float, float]:
    """Real and imaginary part of loop `b` at a frequency."""
    half = math.sin(0.5 * omega * Ts)
    x, y = -2.0 * half * half / Ts, math.sin(omega * Ts) / Ts
    bottom_j = bottom = top_j = top = 0.0
    for k in range(num.shape[1]):
        top, top_j = top * x - top_j * y + num[b, k], top * y + top_j * x
        bottom, bottom_j = bottom * x - bottom_j * y + den[b, k], bottom * y + bottom_j * x
    square = _squared(bottom, bottom_j)
    real = (top * bottom + top_j * bottom_j) / square
    imag = (top_j * bottom - top * bottom_j) / square
    if delay > 0:
        turn = delay * Ts * omega
        c, s = math.cos(turn), math.sin(turn)
        real, imag = real * c + imag * s, imag * c - real * s
    return real, imag


@subkernel
def _crossing(
    num: NDArray[np.float64],
    den: NDArray[np.float64],
    b: int,
    Ts: float,
    delay: int,
    real_axis: bool,
    low: float,
    high: float,
) -> float:
    """Where between two frequencies the loop meets the real axis, or else the unit circle."""
    f_low = f_high = math.nan
    at = low
    for step in range(_REFINEMENTS):
        real, imag = _at(num, den, b, Ts, delay, at)
        f = imag if real_axis else math.log(_squared(imag, real))
        if step == 0:
            f_low, at = f, high
            continue
        if step > 1 and (f < 0.0) == (f_high < 0.0):
            f_low *= 0.5
        elif step > 1:
            low, f_low = high, f_high
        high, f_high = at, f
        at = high - f_high * (high - low) / (f_high - f_low)
        if f == 0.0 or abs(at - high) <= 2e-16 * high:
            break
    return high


@subkernel
def _distance(
    num: NDArray[np.float64], den: NDArray[np.float64], b: int, Ts: float, delay: int, omega: float
) -> float:
    """Square of the distance from -1."""
    real, imag = _at(num, den, b, Ts, delay, omega)
    return _squared(1.0 + real, imag)


@subkernel
def _nearest(
    num: NDArray[np.float64],
    den: NDArray[np.float64],
    b: int,
    Ts: float,
    delay: int,
    low: float,
    high: float,
) -> float:
    """Least distance from -1 between two frequencies, by golden sections."""
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left = _distance(num, den, b, Ts, delay, left)
    at_right = _distance(num, den, b, Ts, delay, right)
    for _ in range(_SECTIONS):
        if at_left < at_right:
            high, right, at_right = right, left, at_left
            left = high - _GOLDEN * (high - low)
            at_left = _distance(num, den, b, Ts, delay, left)
        else:
            low, left, at_left = left, right, at_right
            right = low + _GOLDEN * (high - low)
            at_right = _distance(num, den, b, Ts, delay, right)
    return math.sqrt(at_right if at_right < at_left else at_left)


@kernel
def _margins(
    num: NDArray[np.float64],
    den: NDArray[np.float64],
    Ts: float,
    delay: int,
    grid: NDArray[np.float64],
    work: NDArray[np.float64],
    found: NDArray[np.float64],
) -> None:
    """`Margins` (B, 6); `work` (6, F)."""
    last = grid.shape[1] - 1
    real, imag = work[4], work[5]
    # Numba would compile a version for every literal.
    on_circle, on_axis = bool(False), bool(True)  # noqa: UP018
    for b in range(len(num)):
        # `_at` the whole grid, power by power, so that it vectorises.
        for i in range(last + 1):
            work[0, i] = work[1, i] = work[2, i] = work[3, i] = 0.0
        for k in range(num.shape[1]):
            n, d = num[b, k], den[b, k]
            for i in range(last + 1):
                x, y = grid[1, i], grid[2, i]
                top, top_j, bottom, bottom_j = work[0, i], work[1, i], work[2, i], work[3, i]
                work[0, i] = top * x - top_j * y + n
                work[1, i] = top * y + top_j * x
                work[2, i] = bottom * x - bottom_j * y + d
                work[3, i] = bottom * y + bottom_j * x
        for i in range(last + 1):
            top, top_j, bottom, bottom_j = work[0, i], work[1, i], work[2, i], work[3, i]
            square = _squared(bottom, bottom_j)
            re = (top * bottom + top_j * bottom_j) / square
            im = (top_j * bottom - top * bottom_j) / square
            real[i] = re * grid[3, i] - im * grid[4, i]
            imag[i] = re * grid[4, i] + im * grid[3, i]

        crossover = math.nan
        i = last
        while i >= 0 and _squared(real[i], imag[i]) < 1.0:
            i -= 1
        if 0 <= i < last:
            crossover = _crossing(num, den, b, Ts, delay, on_circle, grid[0, i], grid[0, i + 1])

        phase_crossover, gain_margin = math.nan, math.inf
        nearest, least = 0, math.inf
        for i in range(last + 1):
            squared = _squared(1.0 + real[i], imag[i])
            if squared < least:
                nearest, least = i, squared
            if i == last or (real[i] > 0.0 and real[i + 1] > 0.0):
                continue
            if (imag[i] < 0.0) != (imag[i + 1] < 0.0):
                at = _crossing(num, den, b, Ts, delay, on_axis, grid[0, i], grid[0, i + 1])
            elif i + 1 == last:
                at = grid[0, last]  # the loop is real at the Nyquist frequency
            else:
                continue
            value, _ = _at(num, den, b, Ts, delay, at)
            if value < 0.0 and abs(math.log(-value)) < abs(gain_margin):
                gain_margin, phase_crossover = -math.log(-value), at

        low, high = nearest - (nearest > 0), nearest + (nearest < last)
        modulus = _nearest(num, den, b, Ts, delay, grid[0, low], grid[0, high])

        opposite, opposite_j = _at(num, den, b, Ts, delay, crossover)
        phase = math.atan2(-opposite_j, -opposite)
        found[b, 0] = phase * (180.0 / math.pi)
        found[b, 1] = crossover / (2.0 * math.pi)
        found[b, 2] = gain_margin * (20.0 / math.log(10.0))
        found[b, 3] = phase_crossover / (2.0 * math.pi)
        found[b, 4] = modulus
        found[b, 5] = (phase % (2.0 * math.pi)) / crossover
