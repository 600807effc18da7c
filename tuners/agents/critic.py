"""Critic: a cone fitted to rewards as they come, and the actions tried around its best.

Residuals have weights ``1/(2 s + e^2/2)``, s the median error of the last fit's forecasts of new
rewards: far from the best action a cone is a poor model.  Actions are Gaussian around the best one,
round in e, with a root mean square of ``sqrt(s)``: near by the noise is larger than the slope.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.agents.cone import Cone, fit

Array = NDArray[np.float64]

FAR = 0.15
"""Share of the actions that are drawn from a wider Gaussian."""

_FARTHER = 4.0  # how much wider
_WIDEST = 0.7  # exploration, in units of the error
_CURVATURE = 0.5  # how far off a cone is at errors of one
_NOISE = 0.5  # before anything is known of it
_STEPS = 25


@dataclass(frozen=True, slots=True, eq=False)
class Critic:
    """A fitted cone.

    Attributes
    ----------
    weights : NDArray
        (p,) of the cone.
    noise : float
        Median error of the forecasts of new rewards by the fit before.
    spread : float
        Root mean square of the exploration to come, in units of the error.
    cost : float
        Weighted sum of squares.
    """

    weights: Array
    noise: float
    spread: float
    cost: float


def weighted(noise: float, e: Array) -> Array:
    """How much errors e (N,) count, (N,)."""
    return np.asarray(1 / (2 * noise + _CURVATURE * e**2))


def refitted(
    cone: Cone,
    last: Array | None,
    x: Array,
    a: Array,
    e: Array,
    known: int,
    rng: np.random.Generator,
    restarts: int,
    early: bool,
) -> Critic:
    """Fit a cone to all rewards so far.

    Parameters
    ----------
    last : (p,) float64, optional
        Weights of the fit before.
    x, a, e : (N, n), (N, m), (N,) float64
        Observations, actions and errors.
    known : int
        How many of them the fit before knew.
    restarts : int
        Random starts beside the last weights, early on or where there are none.
    early : bool
        Whether data are few: more starts, and more steps of each.
    """
    starts, noise = [], _NOISE
    if last is not None:
        forecast = cone.errors(last, x[known:], a[known:])
        noise = float(np.median(np.abs(forecast - e[known:])))
        starts.append(last)
    if early or not starts:
        starts += [cone.start(rng) for _ in range(max(restarts, 1 - len(starts)))]
    weight, steps = weighted(noise, e), _STEPS * (3 if early else 1)
    found = [fit(cone, start, x, a, e, weight, steps) for start in starts]
    weights, cost = min(found, key=lambda pair: pair[1])
    return Critic(weights, noise, min(_WIDEST, float(np.sqrt(noise))), cost)


def explored(
    cone: Cone, weights: Array, x: Array, spread: float, far: NDArray[np.bool_], normal: Array
) -> Array:
    """Actions (B, m) in [-1, 1] around the best ones, from normal numbers (B, m).

    Parameters
    ----------
    far : (B, 1) bool
        Which are drawn from the wider Gaussian.
    """
    off = np.where(far, _FARTHER, 1.0) * spread / np.sqrt(cone.actions) * normal
    away = np.linalg.solve(cone.factor(weights, x), off[:, :, None])[:, :, 0]
    return np.asarray(np.clip(cone.best(weights, x) + away, -1, 1))
