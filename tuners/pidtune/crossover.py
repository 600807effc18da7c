"""Choose a crossover where none is given.

This is our rule, not MATLAB's, whose search is unpublished: the highest frequency, within
the plant's corners or a decade of them, at which the plant's phase still leaves the margin
when the controller supplies what its kind supplies best (`yawrate_env.loop.law.KINDS`; a PI no
more than half of the lag that the plant leaves it at low frequency).  Where that loop is not
stable, or misses the target, frequencies a factor of 2, 4, ... below and above are tried.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from tuners.pidtune.system import System
from yawrate_env.loop.law import Kind

_POINTS = 500
_FACTORS = (1, 1 / 2, 2, 1 / 4, 4, 1 / 8, 8, 1 / 16, 16)


def needed_phase(plant: System, omega: Any, pm: float) -> Any:
    """Phase that a controller must supply at `omega` for a margin of `pm` degrees [rad]."""
    return np.radians(pm) - np.pi - plant.phase(omega)


def free_crossovers(plant: System, kind: Kind, pm: float) -> Iterator[float]:
    """Crossovers [rad/s], the best first."""
    first = _best(plant, kind, pm)
    yield from (first * k for k in _FACTORS if first * k <= plant.largest_crossover())


def _best(plant: System, kind: Kind, pm: float) -> float:
    from scipy.optimize import brentq

    corners = plant.corners
    limit = plant.largest_crossover()
    if not len(corners):
        return limit / 9 if plant.Ts else 1.0  # no time scale: any will do
    low, high = corners.min() / 10, corners.max() * 10
    if low >= limit / 2:
        return limit / 2
    grid = np.geomspace(low, min(high, limit / 2), _POINTS)
    needed = needed_phase(plant, grid, pm)
    supplied = kind.free_phase
    if kind.zeros == kind.integrators == 1:
        supplied = max(supplied, needed[0] / 2)
    enough = np.flatnonzero(needed <= supplied)
    if not len(enough):
        return float(grid[np.argmin(needed)])
    i = enough[-1]
    if i + 1 == len(grid):
        return float(grid[i])
    return float(brentq(lambda w: needed_phase(plant, w, pm) - supplied, grid[i], grid[i + 1]))
