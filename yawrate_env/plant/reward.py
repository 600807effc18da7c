"""The reward: distance of a loop's metrics from their targets.

    e = |(metric - target) / scale|          over the metrics that count
    reward = -e / (1 + e/4)          stable loops: in (-4, 0], slope -1 at the target
    reward = -4                      stable, with an undefined metric
    reward = -5                      unstable

Unlike a clipped error it still slopes when far off, and no unstable loop can be worth
more than a stable one.
"""

import numpy as np
from numpy.typing import NDArray

WORST_STABLE = -4.0
UNSTABLE = -5.0


def defined(values: NDArray[np.float64], stable: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Metrics (B, f) as the reward takes them.

    ``nan`` where the loop is not stable (B,), ``inf`` where it is and a metric is undefined.
    """
    return np.where(stable[:, None], np.where(np.isfinite(values), values, np.inf), np.nan)


def distance(scaled: NDArray[np.float64]) -> NDArray[np.float64]:
    """Euclidean norm (B,) of scaled errors (B, f)."""
    return np.asarray(np.abs(np.hypot.reduce(scaled, axis=1)))


def reward(scaled: NDArray[np.float64]) -> NDArray[np.float64]:
    """Reward (B,) of scaled errors (B, f); ``nan`` where unstable, ``inf`` where undefined."""
    e = distance(scaled)
    finite = np.isfinite(e)
    stable = np.where(finite, e, 0.0)
    graded = np.where(finite, WORST_STABLE * stable / (stable - WORST_STABLE), WORST_STABLE)
    return np.where(np.isnan(scaled).any(axis=1), UNSTABLE, graded)


def error_of(rewards: NDArray[np.float64], farthest: float = 12.0) -> NDArray[np.float64]:
    """Distances (B,) that rewards (B,) stand for: the inverse of `reward`.

    Rewards below that of `farthest`, those of unstable loops among them, count as that.
    """
    r = np.maximum(rewards, WORST_STABLE * farthest / (farthest - WORST_STABLE))
    return np.asarray(WORST_STABLE * r / (r - WORST_STABLE))
