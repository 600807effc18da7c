"""Conservative gains, for results that are refused or have no gains."""

import numpy as np
from numpy.typing import NDArray

from yawrate_env.plant.episodes import sample
from yawrate_env.plant.plant import Plant
from yawrate_env.plant.reward import UNSTABLE

Array = NDArray[np.float64]

_CANDIDATES = 48


def fallback(plant: Plant) -> Array:
    """Gains (k,) that are right for some plant of the prior and stable for all sampled ones.

    Of the gains that suit some plant, those with the highest reward with the plant that they
    suit least; ``nan`` where all of them make some other plant unstable.
    """
    theta = sample(plant, _CANDIDATES)
    gains, reached = plant.designs(theta)
    theta, gains = theta[reached], gains[reached]
    each = len(theta)
    if each:
        pairs = np.repeat(gains, each, axis=0)
        reward = plant.reward(np.tile(theta, (each, 1)), pairs)
        least = reward.reshape(each, each).min(axis=1)
        if (least > UNSTABLE).any():
            return np.asarray(gains[np.argmax(least)])
    return np.full(len(plant.gains), np.nan)
