"""First stage: the recording's own frequency response around the crossover.

A Laguerre model is fitted by least squares; its log magnitude and phase at a few frequencies
are the features.  The controller's magnitude and phase at the crossover are nearly linear in
them, also where measured parameters vary, so that a learner need not model a strongly nonlinear
map from coefficients.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre import Laguerre

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FrequencyResponse:
    """First stage: log magnitude and phase [rad] of a Laguerre model.

    Attributes
    ----------
    order : int
        Number of Laguerre functions.
    pole : float
        Their common pole, continuous [rad/s].
    low, high : float
        Lowest and highest frequency [Hz].
    points : int
        Frequencies, evenly spaced in their logarithm.
    """

    order: int = 12
    pole: float = 12.0
    low: float = 0.3
    high: float = 6.0
    points: int = 6

    any_experiment: ClassVar[bool] = True
    one_pair: ClassVar[bool] = True

    @property
    def width(self) -> int:
        """Number of features."""
        return 2 * self.points

    def __call__(self, u: Array, y: Array, Ts: float) -> tuple[Array, NDArray[np.bool_]]:
        """Features (B, 2 points) of episodes sampled at `Ts` [s], and which are usable (B,)."""
        coefficients, usable = Laguerre(self.order, self.pole)(u, y, Ts)
        features = self.of(coefficients, Ts)
        return features, np.asarray(usable & np.isfinite(features).all(axis=1))

    def of(self, coefficients: Array, Ts: float) -> Array:
        """Features (B, 2 points) of Laguerre coefficients (B, order)."""
        response = coefficients @ self.functions(Ts)
        with np.errstate(divide="ignore", invalid="ignore"):
            magnitude = np.log(np.abs(response))
        return np.concatenate([magnitude, np.unwrap(np.angle(response), axis=1)], axis=1)

    def functions(self, Ts: float) -> NDArray[np.complex128]:
        """Responses of the Laguerre functions at its frequencies, (order, points)."""
        omega = 2 * np.pi * np.geomspace(self.low, self.high, self.points)
        return Laguerre(self.order, self.pole).frequency_response(omega, Ts)
