"""Margins of open loops ``L = C G z^-d``, batched.

A compiled loop evaluates the ratios of polynomials in ``delta = (z - 1)/Ts`` on a frequency grid;
the crossings found there are refined to machine precision by the Illinois rule (Dowell and
Jarratt, 1971), in a tenth of the evaluations that bisection needs.
"""

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
    omega, delta, lag = _grid(Ts, delay)
    num, den = np.ascontiguousarray(num), np.ascontiguousarray(den)
    found = np.empty((len(num), 6))

    def some(i: int, j: int) -> None:
        L, work = np.empty(len(omega), dtype=np.complex128), np.empty((4, len(omega)))
        _margins(num[i:j], den[i:j], Ts, delay, omega, delta, lag, L, work, found[i:j])

    over_blocks(some, len(num), _BLOCK)
    return found


@cache
def _grid(
    Ts: float, delay_samples: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.complex128]]:
    """Frequencies (F,) [rad/s], their delta (2, F) and the delay's response (F,)."""
    omega = np.concatenate([np.logspace(-9.5, -3.5, 48, False), np.logspace(-3.5, 0, 225)])
    omega *= np.pi / Ts
    delta = delta_operator(omega, Ts)
    lag = np.exp(-1j * delay_samples * Ts * omega)
    return omega, np.stack([delta.real, delta.imag]), lag


@subkernel
def _ratio(top: complex, bottom: complex) -> complex:
    """Complex division without the branches of Python's."""
    return top * bottom.conjugate() / (bottom.real * bottom.real + bottom.imag * bottom.imag)


@subkernel
def _squared(value: complex) -> float:
    return value.real * value.real + value.imag * value.imag


@subkernel
def _at(
    num: NDArray[np.float64], den: NDArray[np.float64], Ts: float, delay: int, omega: float
) -> complex:
    half = np.sin(0.5 * omega * Ts)
    delta = complex(-2.0 * half * half / Ts, np.sin(omega * Ts) / Ts)
    top, bottom = 0j, 0j
    for k in range(len(num)):
        top = top * delta + num[k]
        bottom = bottom * delta + den[k]
    value = _ratio(top, bottom)
    if delay > 0:
        value *= np.exp(-1j * (delay * Ts * omega))
    return value


@subkernel
def _on_grid(
    num: NDArray[np.float64],
    den: NDArray[np.float64],
    delta: NDArray[np.float64],
    lag: NDArray[np.complex128],
    work: NDArray[np.float64],
    L: NDArray[np.complex128],
) -> None:
    """`_at` the whole grid, power by power, so that it vectorises; `work` is (4, F)."""
    re, im = delta[0], delta[1]
    top, top_j, bottom, bottom_j = work[0], work[1], work[2], work[3]
    for i in range(len(re)):
        top[i] = top_j[i] = bottom[i] = bottom_j[i] = 0.0
    for k in range(len(num)):
        n, d = num[k], den[k]
        for i in range(len(re)):
            x, y = re[i], im[i]
            top[i], top_j[i] = top[i] * x - top_j[i] * y + n, top[i] * y + top_j[i] * x
            bottom[i], bottom_j[i] = (
                bottom[i] * x - bottom_j[i] * y + d,
                bottom[i] * y + bottom_j[i] * x,
            )
    for i in range(len(re)):
        L[i] = _ratio(complex(top[i], top_j[i]), complex(bottom[i], bottom_j[i])) * lag[i]


@subkernel
def _crossing(
    num: NDArray[np.float64],
    den: NDArray[np.float64],
    Ts: float,
    delay: int,
    real_axis: bool,
    low: float,
    high: float,
) -> float:
    """Where between two frequencies the loop meets the real axis, or else the unit circle."""
    f_low = f_high = np.nan
    at = low
    for step in range(_REFINEMENTS):
        value = _at(num, den, Ts, delay, at)
        f = value.imag if real_axis else np.log(_squared(value))
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
def _nearest(
    num: NDArray[np.float64],
    den: NDArray[np.float64],
    Ts: float,
    delay: int,
    low: float,
    high: float,
) -> float:
    """Least distance from -1 between two frequencies, by golden sections."""
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left = _squared(1.0 + _at(num, den, Ts, delay, left))
    at_right = _squared(1.0 + _at(num, den, Ts, delay, right))
    for _ in range(_SECTIONS):
        if at_left < at_right:
            high, right, at_right = right, left, at_left
            left = high - _GOLDEN * (high - low)
            at_left = _squared(1.0 + _at(num, den, Ts, delay, left))
        else:
            low, left, at_left = left, right, at_right
            right = low + _GOLDEN * (high - low)
            at_right = _squared(1.0 + _at(num, den, Ts, delay, right))
    return float(np.sqrt(min(at_left, at_right)))


@kernel
def _margins(
    num: NDArray[np.float64],
    den: NDArray[np.float64],
    Ts: float,
    delay: int,
    grid: NDArray[np.float64],
    delta: NDArray[np.float64],
    lag: NDArray[np.complex128],
    L: NDArray[np.complex128],
    work: NDArray[np.float64],
    found: NDArray[np.float64],
) -> None:
    last = len(grid) - 1
    for b in range(len(num)):
        loop = (num[b], den[b], Ts, delay)
        _on_grid(num[b], den[b], delta, lag, work, L)

        crossover = np.nan
        i = last
        while i >= 0 and _squared(L[i]) < 1.0:
            i -= 1
        if 0 <= i < last:
            crossover = _crossing(*loop, False, grid[i], grid[i + 1])

        phase_crossover, gain_margin = np.nan, np.inf
        for i in range(last):
            if L[i].real > 0.0 and L[i + 1].real > 0.0:
                continue
            if (L[i].imag < 0.0) != (L[i + 1].imag < 0.0):
                at = _crossing(*loop, True, grid[i], grid[i + 1])
            elif i + 1 == last:
                at = grid[last]  # the loop is real at the Nyquist frequency
            else:
                continue
            value = _at(*loop, at)
            if value.real < 0.0 and abs(np.log(-value.real)) < abs(gain_margin):
                gain_margin, phase_crossover = -np.log(-value.real), at

        nearest = 0
        for i in range(len(grid)):
            if _squared(1.0 + L[i]) < _squared(1.0 + L[nearest]):
                nearest = i
        modulus = _nearest(*loop, grid[max(nearest - 1, 0)], grid[min(nearest + 1, last)])

        opposite = -_at(*loop, crossover)
        # Not np.angle, with which Numba imports SciPy's linear algebra.
        phase = np.arctan2(opposite.imag, opposite.real)
        found[b, 0] = np.degrees(phase)
        found[b, 1] = crossover / (2.0 * np.pi)
        found[b, 2] = gain_margin * (20.0 / np.log(10.0))
        found[b, 3] = phase_crossover / (2.0 * np.pi)
        found[b, 4] = modulus
        found[b, 5] = (phase % (2.0 * np.pi)) / crossover
