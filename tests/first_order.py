"""A plant whose every answer is known in closed form: K/(T s + 1), sampled with a hold."""

import numpy as np
from numba import njit

from yawrate_env.plant.plant import Plant
from yawrate_env.signals.excitation import prbs

TS, TAU, SIGMA = 0.02, 0.3, 0.02
U = prbs(500, TS, 0.5, 1.0)[0]


@njit(cache=True)
def recursion(a, b, u):
    y = np.zeros(u.shape)
    for i in range(len(u)):
        for k in range(u.shape[1] - 1):
            y[i, k + 1] = a[i] * y[i, k] + b[i] * u[i, k]
    return y


def simulate(theta, u, rng):
    K, T = theta.T
    a = np.exp(-TS / T)
    return recursion(a, K * (1 - a), np.broadcast_to(u, (len(theta), np.shape(u)[-1])))


def design(theta):
    """Pole cancellation: the loop becomes 1/(TAU s)."""
    K, T = theta.T
    return np.stack([T / (K * TAU), T], axis=1)


def described(**changes) -> Plant:
    settings = {
        "prior": {"K": (0.5, 2.0), "T": (0.2, 1.0)},
        "simulate": simulate,
        "design": design,
        "gains": ("kp", "Ti"),
        "u": U,
        "Ts": TS,
        "noise": SIGMA,
        "signals": ("valve [%]", "flow [l/s]"),
        "entry": "first_order:plant",
    }
    return Plant(**(settings | changes))


def by_one(function):
    """The same function for one plant at a time."""
    return lambda theta, *rest: function(np.asarray(theta)[None], *rest)[0]


def slopes(theta):
    """Derivatives of one plant's output to K and T, from the recursion's own derivative."""
    K, T = theta
    a = np.exp(-TS / T)
    y, by_T = np.zeros(len(U)), np.zeros(len(U))
    for k in range(len(U) - 1):
        y[k + 1] = a * y[k] + K * (1 - a) * U[k]
        by_T[k + 1] = a * by_T[k] + a * TS / T**2 * (y[k] - K * U[k])
    return np.stack([y / K, by_T])


plant = described()
CROSSOVER = 1 / (2 * np.pi * TAU)

linear = described(linear=True, crossover=CROSSOVER, entry="first_order:linear")
weighed = described(
    measured={"K": 0.05}, linear=True, crossover=CROSSOVER, entry="first_order:weighed"
)
gauged = described(
    measured={"K": 0.05},
    linear=True,
    crossover=CROSSOVER,
    black_box=(6, 3.0),
    entry="first_order:gauged",
)
lone = described(
    prior={"K": (0.5, 2.0), "T": (0.5, 0.5)},
    design=lambda theta: design(theta)[:, :1],
    gains=("kp",),
    entry="first_order:lone",
)
