"""How much of an episode's Fisher information is left in its features.

Features that move with the unknown parameters by ``D`` and scatter with covariance ``C``
hold ``D^T C^-1 D`` of it for an estimator that works with their mean and covariance.
Parameters are in widths of their ranges, as in `tuners.trust.bound`.

Laguerre coefficients are linear in the output, ``c = (Phi^T Phi)^-1 Phi^T y``, so that this
is ``S^T P S / sigma^2`` with the output's sensitivity S and the projection P on the
regressors Phi.  The ARMAX fit is not, and its reduced order makes its features depend on
the noise: D and C come from recordings of the same plant with fresh noise.
"""

import numpy as np
from numpy.typing import NDArray

from tuners.features.armax import Armax
from tuners.features.laguerre import Laguerre, lifted
from tuners.trust.identification import output_slopes
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.decimation import averaged

Array = NDArray[np.float64]

RECORDINGS = 100
_STEP = 3e-3  # of a range, for what is not linear in the output; the same noise on both sides


def after_averaging(plant: Plant, theta: Array, u: Array, block: int) -> Array:
    """Information that block averages keep, (B, q, q)."""
    A = averaged(output_slopes(plant, theta, u), block)
    return np.asarray(A @ A.swapaxes(1, 2) / (_variance(plant, theta, u) / block)[:, None, None])


def in_laguerre(plant: Plant, theta: Array, u: Array, features: Laguerre) -> Array:
    """Information in Laguerre coefficients, (B, q, q)."""
    slopes, none = output_slopes(plant, theta, u), np.empty((0, u.shape[1]))
    sides = [
        features.normal_equations(u, np.ascontiguousarray(slopes[:, i]), plant.Ts, none)
        for i in range(slopes.shape[1])
    ]
    gram, right = lifted(sides[0][0]), np.stack([right for _, right in sides], axis=2)
    kept = right.swapaxes(1, 2) @ np.linalg.solve(gram, right)
    return np.asarray(kept / _variance(plant, theta, u)[:, None, None])


def in_armax(
    plant: Plant, theta: Array, u: Array, features: Armax, seed: int = 0,
    recordings: int = RECORDINGS,
) -> Array:  # fmt: skip
    """Information in ARMAX coefficients, (B, q, q), from `recordings` of each plant."""
    rng = np.random.default_rng(seed)
    own = np.broadcast_to(u, (len(theta), u.shape[1]))
    return np.stack(
        [
            _in_armax(plant, theta[b], own[b : b + 1], features, rng, recordings)
            for b in range(len(theta))
        ]
    )


def _in_armax(
    plant: Plant, theta: Array, u: Array, features: Armax, rng: np.random.Generator,
    recordings: int,
) -> Array:  # fmt: skip
    """`in_armax` of one plant (p,); averages of white noise are white, and drawn as such."""
    block = round(features.Ts / plant.Ts)
    sigma = np.sqrt(_variance(plant, theta[None], u) / block)
    noise = sigma * rng.standard_normal((recordings, u.shape[1] // block))

    def noisy(moved: Array) -> Array:
        clean = averaged(plant.respond(moved[None], u), block)
        return features(averaged(u, block), clean + noise, features.Ts)[0]

    steps = np.zeros((len(plant.unknown), len(theta)))
    steps[np.arange(len(steps)), plant.unknown] = _STEP * plant.width
    sides = [(noisy(theta + step), noisy(theta - step)) for step in steps]
    D = np.stack([(up - down).mean(axis=0) for up, down in sides], axis=1) / (2 * _STEP)
    C = np.cov(noisy(theta).T)
    # An inverse of a sample covariance is too large on average (Hartlap et al., 2007).
    unbiased = (recordings - len(C) - 2) / (recordings - 1)
    return np.asarray(unbiased * D.T @ np.linalg.solve(C, D))


def _variance(plant: Plant, theta: Array, u: Array) -> Array:
    """Of the measurement noise, (B,)."""
    return plant.sigma(plant.respond(theta, u)) ** 2
