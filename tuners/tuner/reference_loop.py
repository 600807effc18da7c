"""The reference model of the direct methods: a loop with exactly the wanted margins.

Virtual and fictitious reference tuning want a closed loop ``M = L/(1 + L)``.  With
``q = z^-1`` at the controller's sampling time and d samples of computation delay,

    L = K q^(1+d) / ((1 - q) (1 - p q)),

an integrator and a first-order lag behind a hold: a second-order closed loop.  K and p follow from
the target: with ``theta = omega_c Ts`` the loop's phase at the crossover is

    -pi/2 - (1/2 + d) theta - phi,    p = sin(phi) / sin(theta + phi),

so that phi is what the phase margin leaves, and K makes the magnitude one.  Where hold and delay
take more than that, phi < 0 and the lag becomes a lead: ``1 - p q`` in the numerator, p from -phi.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import kernel
from yawrate_env.loop.target import Target

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceLoop:
    """Polynomials, coefficients in ascending powers of q: ``L = gain / ((1 - q) lag)``.

    Attributes
    ----------
    target : Target
        Whose phase margin and crossover the loop has.
    gain : NDArray
        Numerator, with hold and computation delay.
    lag : NDArray
        Denominator without the integrator.
    closed : NDArray
        Denominator ``(1 - q) lag + gain`` of the closed loop.
    """

    target: Target
    gain: Array
    lag: Array
    closed: Array

    @classmethod
    def of(cls, target: Target) -> Self:
        """The loop for a target; ``ValueError`` where it would be unstable."""
        theta, delay = target.omega_c * target.Ts, target.delay_samples
        phi = np.pi / 2 - np.radians(target.phase_margin) - (delay + 0.5) * theta
        factor = np.array([1.0, -np.sin(abs(phi)) / np.sin(theta + abs(phi))])
        lead, lag = (np.ones(1), factor) if phi >= 0 else (factor, np.ones(1))
        gain = np.concatenate([np.zeros(1 + delay), lead])
        difference = np.convolve([1.0, -1.0], lag)
        q = np.exp(-1j * theta)
        gain /= abs(np.polyval(gain[::-1], q) / np.polyval(difference[::-1], q))
        closed = np.zeros(max(len(gain), len(difference)))
        closed[: len(gain)] += gain
        closed[: len(difference)] += difference
        if not (np.isfinite(closed).all() and (np.abs(np.roots(closed)) < 1).all()):
            raise ValueError(
                f"phase_margin = {target.phase_margin:g}: no stable reference loop has it at this "
                f"crossover behind {delay} samples of delay. Change the target."
            )
        return cls(target, gain, lag, closed)

    @property
    def sensitivity(self) -> Array:
        """Numerator ``(1 - q) lag`` of ``1 - M``."""
        return np.convolve([1.0, -1.0], self.lag)

    def resonator(self, quality: float) -> tuple[Array, Array]:
        """Band-pass around the crossover: numerator and denominator (Orfanidis, 1996, sec. 11.3).

        Parameters
        ----------
        quality : float
            Crossover over the width of the band at -3 dB.
        """
        theta = self.target.omega_c * self.target.Ts
        beta = np.tan(theta / (2 * quality))
        inside = np.array([1.0, -2 * np.cos(theta) / (1 + beta), (1 - beta) / (1 + beta)])
        return np.array([1.0, 0.0, -1.0]) * beta / (1 + beta), inside


def filtered(numerator: Array, denominator: Array, x: Array, step: int) -> Array:
    """Signals (B, N) through a filter whose q delays by `step` samples, from rest.

    Every `step`-th sample is a signal at the controller's sampling time; all of them pass.
    """
    out = np.zeros(x.shape)
    _recursion(numerator / denominator[0], denominator / denominator[0], x, step, out)
    return out


@kernel
def _recursion(
    numerator: NDArray[np.float64],
    denominator: NDArray[np.float64],
    x: NDArray[np.float64],
    step: int,
    out: NDArray[np.float64],
) -> None:
    for b in range(len(x)):
        for k in range(0, x.shape[1], step):
            end = min(k + step, x.shape[1])
            for i in range(min(len(numerator), k // step + 1)):
                if numerator[i] != 0.0:
                    for t in range(k, end):
                        out[b, t] += numerator[i] * x[b, t - i * step]
            for i in range(1, min(len(denominator), k // step + 1)):
                if denominator[i] != 0.0:
                    for t in range(k, end):
                        out[b, t] -= denominator[i] * out[b, t - i * step]
