"""The steering actuator's response to a sampled signal, eq. (9)."""

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop.discretisation import expm
from yawrate_env.vehicle.single_track import Vehicle

Array = NDArray[np.float64]


def actuated(signal: Array, Ts: float, vehicle: Vehicle) -> Array:
    """Response (N,) of the actuator to a signal that is linear between its samples.

    It starts in the steady state of the first sample.
    """
    A = np.array([[0.0, 1.0], [-(vehicle.omega_n**2), -2 * vehicle.xi * vehicle.omega_n]])
    X = np.zeros((1, 4, 4))
    X[0, :2, :2], X[0, 1, 2], X[0, 2, 3] = A * Ts, vehicle.omega_n**2 * Ts, 1.0
    E = expm(X)[0]  # x+ = Ad x + b0 u + b1 (u+ - u): a first-order hold (Van Loan, 1978)
    (a, b), (c, d) = E[:2, :2].tolist()
    (h, g), (p, q) = E[0, 2:].tolist(), E[1, 2:].tolist()
    out = np.empty_like(signal)
    x, v = float(signal[0]), 0.0
    values = [*signal.tolist(), float(signal[-1])]
    for k in range(len(signal)):
        out[k] = x
        u, step = values[k], values[k + 1] - values[k]
        x, v = a * x + b * v + h * u + g * step, c * x + d * v + p * u + q * step
    return out
