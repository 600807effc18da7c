"""Plants with several channels: first-order lags from every input to every output."""

import numpy as np
from scipy.signal import lfilter

from yawrate_env.plant import Plant
from yawrate_env.signals.excitation import prbs

TS, N = 1.0, 400
_TWO = prbs(2 * N, TS, 8.0, 1.0, order=9)[0]
U = np.stack([_TWO[:N], _TWO[N:]])


def lag(K, T, u):
    """Output of K/(T s + 1) to a held input (..., N)."""
    a = np.exp(-TS / T)
    return K * lfilter([0, 1 - a], [1, -a], u)


def simulate(theta, u, rng):
    """Outputs (2, N); what crosses is known."""
    K1, K2, T1, T2 = theta
    top = lag(K1, T1, u[0]) + lag(0.4, 5.0, u[1])
    return np.stack([top, lag(-0.3, 7.0, u[0]) + lag(K2, T2, u[1])])


def apart(theta, u, rng):
    """The same without what crosses."""
    K1, K2, T1, T2 = theta
    return np.stack([lag(K1, T1, u[0]), lag(K2, T2, u[1])])


def design(theta):
    """Two loops that cancel the lags."""
    K1, K2, T1, T2 = theta
    return T1 / (5 * K1), T1, T2 / (5 * K2), T2


def described(**changes):
    """A plant with two inputs and two outputs, of which one is noisier."""
    given = {
        "prior": {"K1": (0.5, 1.5), "K2": (0.5, 2.0), "T1": (5.0, 20.0), "T2": (5.0, 20.0)},
        "simulate": simulate,
        "design": design,
        "gains": ("kp1", "Ti1", "kp2", "Ti2"),
        "u": U,
        "Ts": TS,
        "noise": (0.02, 0.05),
        "linear": True,
        "batched": False,
        "channels": (("reflux [kg/s]", "steam [kg/s]"), ("top [K]", "bottom [K]")),
        "entry": "two_by_two:plant",
    }
    return Plant(**{**given, **changes})


plant = described()
