"""Laguerre bases that suit a plant: those of its reference model, and of first stages."""

import numpy as np
from numpy.typing import NDArray

from tuners.features.integrated import Integrated
from tuners.features.laguerre import Laguerre
from tuners.features.regularised import Regularised, regularised
from tuners.trust.black_box import ORDERS, SAMPLES, black_box
from yawrate_env.plant.episodes import sample
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.streams import stream

Array = NDArray[np.float64]

_PLANTS, _MORE_PLANTS, _MOST_PLANTS, _POLES = 16, 64, 512, 25
_SEED = 21
_HIDDEN = 4.0  # of the noise's variance, where a start has some twenty unknowns


def basis(plant: Plant) -> type[Laguerre]:
    """Kind of functions that a plant's response to its input is a sum of."""
    return Integrated if plant.integrating else Laguerre


def functions_for(plant: Plant) -> Laguerre:
    """Laguerre basis of the reference model; chosen automatically if the plant names none.

    For a linear plant the basis grows until its truncation error is hidden by the noise: a free
    response would explain the rest, and a recording from rest would look like a start in motion.
    """
    if plant.black_box is not None:
        return basis(plant)(*plant.black_box)
    inputs = len(plant.inputs_named)
    for order in (order // inputs for order in ORDERS):
        functions = suited(plant, min(order, plant.samples // SAMPLES // inputs))
        if not plant.linear or functions.order < order or _hidden(plant, functions):
            break
    return functions


def _hidden(plant: Plant, functions: Laguerre) -> bool:
    """Whether noise hides the part of clean outputs that free responses would explain."""
    y = plant.respond(sample(plant, _MORE_PLANTS))
    sigma = plant.sigma(plant.stacked(y))
    fits = (black_box(plant, functions, plant.u[None], y, start) for start in ("rest", "unknown"))
    rest, moving = (fit.residual for fit in fits)
    return bool((rest - moving <= _HIDDEN * sigma**2).all())


def left_over(plant: Plant, functions: Laguerre) -> float:
    """Share of the prior's noise-free outputs that black boxes do not explain, root mean squares.

    Where a plant is so nonlinear, a misfit smaller than this cannot be seen.
    """
    y = plant.respond(sample(plant, _PLANTS))
    start = "rest" if plant.linear else "auto"
    left = black_box(plant, functions, plant.u[None], y, start).residual
    y = plant.stacked(y)
    return float(np.sqrt(left / (y.var(axis=1) * y.shape[1])).mean())


def suited(plant: Plant, order: int) -> Laguerre:
    """Laguerre basis with the pole that explains the prior's noise-free outputs best."""
    y = plant.respond(sample(plant, _PLANTS))
    energy = (plant.stacked(y) ** 2).sum(axis=1)
    slowest, fastest = 2 / (plant.samples * plant.Ts), 1 / plant.Ts
    models = [basis(plant)(order, float(pole)) for pole in np.geomspace(slowest, fastest, _POLES)]
    fits = (black_box(plant, model, plant.u[None], y, "rest") for model in models)
    left = [(fit.residual / energy).mean() for fit in fits]
    return models[int(np.argmin(left))]


def suited_to_any_input(plant: Plant, order: int) -> Regularised:
    """The same basis, regularised by the coefficients of simulated plants, for any input."""
    functions = suited(plant, order)
    gram, right, y = equations_of_any_input(plant, functions)
    return regularised(functions, gram, right, plant.sigma(y) ** 2)


def equations_of_any_input(plant: Plant, functions: Laguerre) -> tuple[Array, Array, Array]:
    """Normal equations (B, n, n) and (B, n) of the prior's noise-free outputs (B, N), and these."""
    u = plant.inputs(stream(_SEED, 0, _MOST_PLANTS, 1)[:, 0])
    y = plant.respond(sample(plant, _MOST_PLANTS), u)
    gram, right = functions.normal_equations(u, y, plant.Ts, np.empty((0, y.shape[1])))
    return gram, right, y
