"""The first-order plant with a simulator of which every call counts."""

import time

import numpy as np
from first_order import by_one, described, design, simulate

calls = []
SECONDS = 0.0


def counted(theta, u, rng):
    """One plant, counted in this process."""
    calls.append(1)
    time.sleep(SECONDS)
    return by_one(simulate)(theta, u, rng)


def steepened(theta, u, rng):
    """A valve that is not linear."""
    return by_one(simulate)(theta, u + 0.2 * u**2, rng)


def steep(theta, u, rng):
    """The same of many plants."""
    return simulate(theta, u + 0.2 * u**2, rng)


def bent(theta, u, rng):
    """The same of one, counted."""
    calls.append(1)
    return steepened(theta, u, rng)


def noisy(theta, u, rng):
    """A level that is random in the plant itself."""
    y = by_one(simulate)(theta, u, rng)
    return y if rng is None else y + 0.1 * rng.standard_normal()


def failing(theta, u, rng):
    """Fails where the lag is long."""
    if theta[1] > 0.9:
        raise KeyError("no such lag")
    return by_one(simulate)(theta, u, rng)


def slowly(**changes):
    settings = {
        "simulate": counted,
        "design": by_one(design),
        "batched": False,
        "slow": True,
        "entry": "slow_plant:plant",
    }
    return described(**(settings | changes))


plant = slowly()
linear = slowly(linear=True, entry="slow_plant:linear")


def recording(theta, seed=0):
    """Output of the experiment, with noise."""
    noise = np.random.default_rng(seed).standard_normal(len(plant.u))
    return simulate(np.array([theta]), plant.u, None)[0] + plant.noise * noise
