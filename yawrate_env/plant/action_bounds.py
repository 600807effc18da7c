"""Bounds of the coordinates that agents choose from."""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.plant.calls import call
from yawrate_env.plant.episodes import prior_gains
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

_SPARE = (0.25, 0.125, 0.06, 0.03)  # of the needed range, beyond either end of it
_ROUNDING = 1e-6  # of the needed range, after decoding and encoding


def action_bounds(plant: Plant) -> tuple[Array, Array]:
    """Lowest and highest coordinates, (m,) each.

    The plant's own, or else those that the design rule gives to plants of the prior and a
    quarter of their range more on either side.  It is less where coordinates so far out give
    no gains, or negative ones where all plants need positive ones.
    """
    if plant.action_bounds is not None:
        found = call("action_bounds", plant.action_bounds)
        low, high = validation.finite_array("action_bounds", found, shape=(2, None))
        if not (low < high).all():
            raise ValueError(f"action_bounds = {low}, {high}: give the lowest first.")
        return low, high
    gains = prior_gains(plant)
    values = plant.parametrisation.encode(gains)
    values = values[np.isfinite(values).all(axis=1)]
    positive = (gains > 0).all(axis=0)
    ends = np.stack([values.min(axis=0), values.max(axis=0)])
    width = np.maximum(np.ptp(ends, axis=0), 4e-3 + 4e-3 * np.abs(ends[0]))  # a point has none
    for side, i in np.ndindex(*ends.shape):
        for share in _SPARE:
            wider = ends.copy()
            wider[side, i] += (share if side else -share) * width[i]
            coordinates = corners(*wider)
            decoded = plant.parametrisation.decode(coordinates)
            lost = np.abs(plant.parametrisation.encode(decoded) - coordinates)
            if (lost <= _ROUNDING * width).all() and (decoded[:, positive] > 0).all():
                ends = wider
                break
    return ends[0], ends[1]


def corners(low: Array, high: Array) -> Array:
    """Corners (2^m, m) of a box."""
    return np.array(list(product(*zip(low, high, strict=True))))
