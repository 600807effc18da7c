"""A model that knows nothing of the plant: Laguerre functions with a pole that suits it."""

import numpy as np
from numpy.typing import NDArray

from tuners.laguerre import Laguerre, lifted
from tuners.plants.data import parameters
from tuners.plants.plant import Plant
from yawrate_env.episode import stream

Array = NDArray[np.float64]

_PLANTS, _POLES = 16, 25
_SEED = 20


def sample(plant: Plant, count: int) -> Array:
    """(count, p) parameters of the prior that belong to no data set, always the same."""
    return parameters(plant, stream(_SEED, 0, count, len(plant.prior)))


def suited(plant: Plant, order: int) -> Laguerre:
    """Laguerre functions whose pole leaves least of the prior's noise-free outputs over."""
    y = plant.respond(sample(plant, _PLANTS))
    energy = (y**2).sum(axis=1)
    slowest, fastest = 2 / (len(plant.u) * plant.Ts), 1 / plant.Ts
    models = [Laguerre(order, float(pole)) for pole in np.geomspace(slowest, fastest, _POLES)]
    left = [(unexplained(model, plant.u, y, plant.Ts) / energy).mean() for model in models]
    return models[int(np.argmin(left))]


def unexplained(model: Laguerre, u: Array, y: Array, Ts: float) -> Array:
    """Sums of squares of outputs (B, N) that a fitted model leaves over, (B,)."""
    gram, right = model.normal_equations(u[None], y, Ts, np.empty((0, len(u))))
    solution = np.linalg.solve(lifted(gram), right[..., None])[..., 0]
    return np.asarray((y**2).sum(axis=1) - (right * solution).sum(axis=1))
