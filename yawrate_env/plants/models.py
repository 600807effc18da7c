r"""Equations of the ready plants, from parameters to matrices and to processes.

A plant's last parameter is its dead time; these are for what is before it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop.dead_time import zoh_late
from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.process_rules import Process

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ProcessModel:
    """Plants behind a dead time.

    Attributes
    ----------
    matrices : callable
        ``matrices(theta)``: parameters (B, p) to A (B, n, n), B (B, n) and C (n,).
    lags : callable
        ``lags(theta)``: the steady gain (B,), or an integrator's slope, and two lags (B,) [s] as
        in `Process`.
    """

    matrices: Callable[[Array], tuple[Array, Array, Array]]
    lags: Callable[[Array], tuple[Array, Array, Array]]

    def discrete(self, theta: Array, Ts: float) -> DiscretePlant:
        """Parameters (B, p) to plants for an input that is held for ``Ts`` [s]."""
        return zoh_late(*self.matrices(theta), Ts, theta[:, -1])

    def process(self, theta: Array, hold: float) -> Process:
        """Parameters (B, p) as processes; `hold` [s] adds to the dead time."""
        return Process(*self.lags(theta), theta[:, -1] + hold)


def _lag_matrices(theta: Array) -> tuple[Array, Array, Array]:
    K, T = theta.T[:2]
    return -1 / T[:, None, None], (K / T)[:, None], np.ones(1)


def _lag_lags(theta: Array) -> tuple[Array, Array, Array]:
    K, T = theta.T[:2]
    return K, T, np.zeros_like(K)


def _two_lags_matrices(theta: Array) -> tuple[Array, Array, Array]:
    return _in_series(*theta.T[:3])


def _two_lags_lags(theta: Array) -> tuple[Array, Array, Array]:
    K, T1, T2 = theta.T[:3]
    return K, T1, T2


def _integrator_matrices(theta: Array) -> tuple[Array, Array, Array]:
    return np.zeros((len(theta), 1, 1)), theta[:, :1], np.ones(1)


def _integrator_lags(theta: Array) -> tuple[Array, Array, Array]:
    K = theta[:, 0]
    return K, np.full_like(K, np.inf), np.zeros_like(K)


def _motor_matrices(theta: Array) -> tuple[Array, Array, Array]:
    """States: current times resistance [V], speed [rad/s]."""
    J, b, K, R, Te = theta.T[:5]
    A, B = np.zeros((len(theta), 2, 2)), np.zeros((len(theta), 2))
    A[:, 0, 0], A[:, 0, 1], B[:, 0] = -1 / Te, -K / Te, 1 / Te
    A[:, 1, 0], A[:, 1, 1] = K / (R * J), -b / J
    return A, B, np.array([0.0, 1.0])


def _motor_lags(theta: Array) -> tuple[Array, Array, Array]:
    """Of a pair of complex poles two equal lags that have its natural frequency."""
    J, b, K, R, Te = theta.T[:5]
    stiffness = b * R + K**2
    product, total = J * R * Te / stiffness, R * (J + b * Te) / stiffness
    root = np.sqrt(np.maximum(total**2 - 4 * product, 0.0))
    lag = np.maximum((total + root) / 2, np.sqrt(product))
    return K / stiffness, lag, product / lag


def _heater_matrices(theta: Array) -> tuple[Array, Array, Array]:
    return _in_series(*_heater_lags(theta))


def _heater_lags(theta: Array) -> tuple[Array, Array, Array]:
    C, h, P, tau = theta.T[:4]
    return P / h, C / h, tau


def _in_series(K: Array, T1: Array, T2: Array) -> tuple[Array, Array, Array]:
    """Two lags; the second drives the first."""
    A, B = np.zeros((len(K), 2, 2)), np.zeros((len(K), 2))
    A[:, 0, 0], A[:, 0, 1], A[:, 1, 1], B[:, 1] = -1 / T1, 1 / T1, -1 / T2, K / T2
    return A, B, np.array([1.0, 0.0])


LAG = ProcessModel(_lag_matrices, _lag_lags)
TWO_LAGS = ProcessModel(_two_lags_matrices, _two_lags_lags)
INTEGRATOR = ProcessModel(_integrator_matrices, _integrator_lags)
MOTOR = ProcessModel(_motor_matrices, _motor_lags)
HEATER = ProcessModel(_heater_matrices, _heater_lags)
