"""Transfer functions in ``delta = (z - 1)/Ts``, batched, with delays in whole samples.

In z the same polynomials would lose the low frequencies to cancellation; here ``delta`` is computed
without it.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop import controller
from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.output_lag import observer_form
from yawrate_env.loop.target import Target


@dataclass(frozen=True, slots=True, eq=False)
class TransferFunction:
    """B ratios of polynomials in delta, highest power first.

    Attributes
    ----------
    num, den : NDArray
        (B, m) float64, the same length, ``den[:, 0] = 1``.
    Ts : float
        Sampling time [s].
    delay_samples : int or NDArray
        Pure delay, the same for all or (B,) int64.
    """

    num: NDArray[np.float64]
    den: NDArray[np.float64]
    Ts: float
    delay_samples: int | NDArray[np.int64] = 0

    @classmethod
    def of(cls, plant: DiscretePlant, delay_samples: int = 0) -> Self:
        """Transfer function of a state-space batch."""
        form, n = observer_form(plant, 1.0), plant.B.shape[1]
        powers = plant.Ts ** np.arange(1.0, n + 1.0)
        num, den = np.zeros((len(form), n + 1)), np.ones((len(form), n + 1))
        num[:, 1:], den[:, 1:] = form.beta / powers, form.alpha / powers
        if plant.D is None or plant.delay is None:
            return cls(num, den, plant.Ts, delay_samples)
        return cls(num + plant.D[:, None] * den, den, plant.Ts, delay_samples + plant.delay)

    def __call__(self, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Frequency response at `omega` [rad/s], (F,) or (B, F) -> (B, F)."""
        delta = delta_operator(omega, self.Ts)
        num, den = (np.zeros(delta.shape[-1:], complex) for _ in range(2))
        for k in range(self.num.shape[1]):
            num = num * delta + self.num[:, k, None]
            den = den * delta + self.den[:, k, None]
        lag = np.exp(-1j * np.reshape(self.delay_samples, (-1, 1)) * self.Ts * omega)
        return np.asarray(num / den * lag)

    def __mul__(self, other: "TransferFunction") -> "TransferFunction":
        """Series connection, plant by plant."""
        return TransferFunction(
            product(self.num, other.num),
            product(self.den, other.den),
            self.Ts,
            self.delay_samples + other.delay_samples,
        )


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


def product(p: NDArray[np.float64], q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Products (B, m + n - 1) of polynomials (B, m) and (B, n)."""
    out = np.zeros((len(p), p.shape[1] + q.shape[1] - 1))
    for k in range(p.shape[1]):
        out[:, k : k + q.shape[1]] += p[:, k, None] * q
    return out
