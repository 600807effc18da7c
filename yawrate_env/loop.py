"""The open loop ``L = C G z^-d``: frequency response and margins, batched.

Plants are turned once into ratios of polynomials in ``delta = (z - 1)/Ts``, which a
compiled loop evaluates on a frequency grid; the crossings found there are bisected to
machine precision.  In z the same polynomials would lose the low frequencies to
cancellation; here ``delta`` is computed without it.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env import controller
from yawrate_env.compiled import kernel, over_blocks
from yawrate_env.discretisation import DiscretePlant
from yawrate_env.task import Target

_BLOCK = 64
_BISECTIONS = 60


@dataclass(frozen=True, slots=True, eq=False)
class TransferFunction:
    """B ratios of polynomials in delta, highest power first.

    Attributes
    ----------
    num, den : NDArray
        (B, m) float64, the same length, ``den[:, 0] = 1``.
    Ts : float
        Sampling time [s].
    delay_samples : int
        Pure delay.
    """

    num: NDArray[np.float64]
    den: NDArray[np.float64]
    Ts: float
    delay_samples: int = 0

    @classmethod
    def of(cls, plant: DiscretePlant, delay_samples: int = 0) -> Self:
        """Transfer function of a state-space batch (Leverrier and Faddeev's recursion)."""
        n = plant.A.shape[1]
        A = (plant.A - np.eye(n)) / plant.Ts
        B = plant.B / plant.Ts
        num, den = np.zeros((len(A), n + 1)), np.ones((len(A), n + 1))
        M = np.broadcast_to(np.eye(n), A.shape)
        for k in range(1, n + 1):
            # Not einsum: its rounding depends on where in memory the arrays happen to lie.
            num[:, k] = ((M * B[:, None, :]).sum(axis=2) * plant.C).sum(axis=1)
            AM = A @ M
            den[:, k] = -np.trace(AM, axis1=1, axis2=2) / k
            M = AM + den[:, k, None, None] * np.eye(n)
        return cls(num, den, plant.Ts, delay_samples)

    def __call__(self, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Frequency response at `omega` [rad/s], (F,) or (B, F) -> (B, F)."""
        delta = delta_operator(omega, self.Ts)
        num, den = (np.zeros(delta.shape[-1:], complex) for _ in range(2))
        for k in range(self.num.shape[1]):
            num = num * delta + self.num[:, k, None]
            den = den * delta + self.den[:, k, None]
        lag = np.exp(-1j * self.delay_samples * self.Ts * omega)
        return np.asarray(num / den * lag)

    def __mul__(self, other: "TransferFunction") -> "TransferFunction":
        """Series connection, plant by plant."""
        return TransferFunction(
            _product(self.num, other.num),
            _product(self.den, other.den),
            self.Ts,
            self.delay_samples + other.delay_samples,
        )


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


def delta_operator(omega: NDArray[np.float64], Ts: float) -> NDArray[np.complex128]:
    """``(exp(j omega Ts) - 1)/Ts`` without cancellation."""
    return np.asarray((-2 * np.sin(omega * Ts / 2) ** 2 + 1j * np.sin(omega * Ts)) / Ts)


def open_loop(
    plant: TransferFunction, kp: NDArray[np.float64], Ti: NDArray[np.float64], target: Target
) -> TransferFunction:
    """Controller times plant, (B,) loops."""
    n1, n0, d0 = controller.coefficients(kp, Ti, target)
    series = TransferFunction(
        np.stack([n1, n0], axis=1), np.stack([np.ones_like(d0), d0], axis=1), plant.Ts
    )
    return series * plant


def margins(loop: TransferFunction) -> Margins:
    """Margins of each loop.

    Crossover, phase crossover and the distance from -1 are looked for on a grid (64
    points a decade over the last 3.5 decades below the Nyquist frequency, 8 a decade
    for six decades below that) and refined between its points, so a resonance of
    damping ratio below 0.02 could hide a crossing.
    """
    nyquist = np.pi / loop.Ts
    grid = nyquist * np.concatenate([np.logspace(-9.5, -3.5, 48, False), np.logspace(-3.5, 0, 225)])
    found = np.empty((6, len(loop.num)))
    num, den = np.ascontiguousarray(loop.num), np.ascontiguousarray(loop.den)

    def work(i: int, j: int) -> None:
        _margins(num[i:j], den[i:j], loop.Ts, loop.delay_samples, grid, _BISECTIONS, found[:, i:j])

    over_blocks(work, len(num), _BLOCK)
    return Margins(*found)


def _product(p: NDArray[np.float64], q: NDArray[np.float64]) -> NDArray[np.float64]:
    out = np.zeros((len(p), p.shape[1] + q.shape[1] - 1))
    for k in range(p.shape[1]):
        out[:, k : k + q.shape[1]] += p[:, k, None] * q
    return out


@kernel
def _at(
    num: NDArray[np.float64], den: NDArray[np.float64], Ts: float, delay: int, omega: float
) -> complex:
    half = np.sin(0.5 * omega * Ts)
    delta = complex(-2.0 * half * half / Ts, np.sin(omega * Ts) / Ts)
    top, bottom = 0j, 0j
    for k in range(len(num)):
        top = top * delta + num[k]
        bottom = bottom * delta + den[k]
    value = top / bottom
    if delay > 0:
        value *= np.exp(-1j * (delay * Ts * omega))
    return value


@kernel
def _margins(
    num: NDArray[np.float64],
    den: NDArray[np.float64],
    Ts: float,
    delay: int,
    grid: NDArray[np.float64],
    bisections: int,
    found: NDArray[np.float64],
) -> None:
    last = len(grid) - 1
    L = np.empty(len(grid), dtype=np.complex128)
    for b in range(len(num)):
        for i in range(len(grid)):
            L[i] = _at(num[b], den[b], Ts, delay, grid[i])

        crossover = np.nan
        i = last
        while i >= 0 and abs(L[i]) < 1.0:
            i -= 1
        if 0 <= i < last:
            low, high = grid[i], grid[i + 1]
            for _ in range(bisections):
                middle = 0.5 * (low + high)
                if abs(_at(num[b], den[b], Ts, delay, middle)) < 1.0:
                    high = middle
                else:
                    low = middle
            crossover = 0.5 * (low + high)

        phase_crossover, gain_margin = np.nan, np.inf
        for i in range(last):
            if (L[i].imag < 0.0) == (L[i + 1].imag < 0.0) and i + 1 < last:
                continue
            low, high = grid[i], grid[i + 1]
            if i + 1 == last and (L[i].imag < 0.0) == (L[last].imag < 0.0):
                low = high  # the loop is real at the Nyquist frequency
            negative = L[i].imag < 0.0
            for _ in range(bisections):
                middle = 0.5 * (low + high)
                if (_at(num[b], den[b], Ts, delay, middle).imag < 0.0) == negative:
                    low = middle
                else:
                    high = middle
            at = 0.5 * (low + high)
            value = _at(num[b], den[b], Ts, delay, at)
            if value.real < 0.0 and abs(np.log(-value.real)) < abs(gain_margin):
                gain_margin, phase_crossover = -np.log(-value.real), at

        nearest = 0
        for i in range(len(grid)):
            if abs(1.0 + L[i]) < abs(1.0 + L[nearest]):
                nearest = i
        low, high = grid[max(nearest - 1, 0)], grid[min(nearest + 1, last)]
        for _ in range(bisections):
            third = (high - low) / 3.0
            left = abs(1.0 + _at(num[b], den[b], Ts, delay, low + third))
            if left < abs(1.0 + _at(num[b], den[b], Ts, delay, high - third)):
                high -= third
            else:
                low += third
        modulus = abs(1.0 + _at(num[b], den[b], Ts, delay, 0.5 * (low + high)))

        phase = np.angle(-_at(num[b], den[b], Ts, delay, crossover))
        found[0, b] = np.degrees(phase)
        found[1, b] = crossover / (2.0 * np.pi)
        found[2, b] = gain_margin * (20.0 / np.log(10.0))
        found[3, b] = phase_crossover / (2.0 * np.pi)
        found[4, b] = modulus
        found[5, b] = (phase % (2.0 * np.pi)) / crossover
