"""Conservative gains for when an answer is not trusted."""

from functools import cache

import numpy as np

from yawrate_env.batch import take
from yawrate_env.loop.margins import margins, open_loop
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Prior, Task

LEAST_DISTANCE = 0.5
"""Of every vehicle's loop from -1: a gain margin of 6 dB and a phase margin of 29 degrees."""

_LOWER = np.array([1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.1])


def prior_grid(prior: Prior, mu_s: int, M_delta: int, v_x: int) -> Context:
    """Vehicles on a grid of so many points over the prior, its ends included."""
    ranges = ((prior.mu_s, mu_s), (prior.M_delta, M_delta), (prior.v_x, v_x))
    axes = [np.linspace(low, high, count if low < high else 1) for (low, high), count in ranges]
    return Context.of(*(axis.ravel() for axis in np.meshgrid(*axes)))


@cache
def fallback(task: Task) -> tuple[float, float]:
    """(kp, Ti) that are safe for every vehicle of the prior; ``nan`` where none are stable.

    Of the gains that are right for some vehicle of a grid, and of the same with lower
    kp, those that keep every vehicle's loop at `LEAST_DISTANCE` and whose slowest loop is
    the fastest; the safest of all where none does.
    """
    vehicles = prior_grid(task.prior, 6, 3, 5)
    design = loops(task, prior_grid(task.prior, 4, 2, 3)).design()
    right = np.isfinite(design.kp)
    kp = (design.kp[right, None] * _LOWER).ravel()
    Ti = np.repeat(design.Ti[right], len(_LOWER))
    count, each = len(vehicles), len(kp)
    judge = loops(task, vehicles)
    every = take(judge.transfer_function, np.repeat(np.arange(count), each))
    found = margins(open_loop(every, np.tile(kp, count), np.tile(Ti, count), task.target))
    distance = found.modulus_margin.reshape(count, each).min(axis=0)
    slowest = np.nan_to_num(found.crossover.reshape(count, each)).min(axis=0)
    score = np.where(distance >= LEAST_DISTANCE, 1.0 + slowest, distance - 1.0)
    for best in np.argsort(-score):  # an unstable loop may keep its distance too
        if judge.evaluate(np.full(count, kp[best]), np.full(count, Ti[best])).stable.all():
            return float(kp[best]), float(Ti[best])
    return np.nan, np.nan
