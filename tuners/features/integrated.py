"""First stage for plants with an integrator: Laguerre functions of the input's integral.

The output of ``G(s)/s`` is that of the stable G to the integral of the input, so that a fit on

    U[k] = Ts (u[0] + ... + u[k]),    phi_i = L_i U

needs no decaying impulse response, and leaves white measurement noise white, where differences
of the output would colour it.  An initial output is a constant in this fit, and an offset of the
input a trend.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre import Laguerre

Array = NDArray[np.float64]

_WINDOWS = 8  # of a recording, in each of which the load may be another


@dataclass(frozen=True, slots=True)
class Integrated(Laguerre):
    """First stage: coefficients on Laguerre functions of the input's integral."""

    def frequency_response(self, omega: Array, Ts: float) -> NDArray[np.complex128]:
        """Response of every function and the integrator at `omega` [rad/s], (order, F)."""
        integrator = Ts / -np.expm1(-1j * omega * Ts)
        return np.asarray(Laguerre.frequency_response(self, omega, Ts) * integrator)

    def loads(self, N: int) -> Array:
        """Output (l, N) of loads that begin one after the other, in windows of equal length."""
        begin = N / _WINDOWS * np.arange(1, _WINDOWS)
        return np.asarray(np.maximum(np.arange(N) - begin[:, None], 0.0) / N)

    def driven(self, u: Array, Ts: float) -> Array:
        """What the functions filter: integrals (E, N) of inputs."""
        return np.asarray(Ts * np.cumsum(u, axis=1))
