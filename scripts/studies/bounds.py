"""Bounds on the episodes of a set, and what the prior can add to them.

`tuners.trust.bound` is the Cramer-Rao bound, which unbiased tuners cannot beat.  A tuner that
knows the prior may be biased and pass below it near the edges of the prior, but not below
the posterior spread on average.  An episode says of the parameters what the least-squares
estimate does, which is Gaussian about the truth with covariance ``F^-1`` as far as the
model is linear; the posterior is that Gaussian about the estimate, cut off at the prior.
"""

from itertools import product

import numpy as np
from numpy.polynomial.hermite_e import hermegauss
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray
from scipy.special import ndtr

from studies.draws import draw
from tuners.trust.bound import cramer_rao, metric_slopes, parameter_covariance, spread
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

_BLOCK = 128
_REACH = 8.0  # standard deviations beyond which a Gaussian weighs nothing
_NODES = 40  # in each of five panels: a Gaussian in one of them to 1e-9
_ESTIMATES = 9  # quadrature nodes in each direction of the estimate's own scatter


def bound_on(plant: Plant, name: str, seed: int, count: int, first: int = 0) -> Array:
    """Cramer-Rao bound on each of `count` episodes of a set, (count, f)."""
    blocks = []
    for at in range(first, first + count, _BLOCK):
        drawn = draw(plant, name, seed, at, min(_BLOCK, first + count - at))
        blocks.append(cramer_rao(plant, drawn.theta, drawn.u))
    return np.concatenate(blocks)


def posterior_on(plant: Plant, name: str, seed: int, count: int) -> Array:
    """`posterior_spread` on each of the first `count` episodes of a set, (count, f)."""
    blocks = []
    for at in range(0, count, _BLOCK):
        drawn = draw(plant, name, seed, at, min(_BLOCK, count - at))
        blocks.append(posterior_spread(plant, drawn.theta, drawn.u))
    return np.concatenate(blocks)


def posterior_spread(plant: Plant, theta: Array, u: Array | None = None) -> Array:
    """Root of the Bayes risk of the metrics (B, f), for plants (B, p) with two unknowns.

    Of the best estimator that knows the prior, at each plant and over the noise.  Its root
    mean square over the prior is the least that any estimator reaches; at a single plant
    near an edge another may do better.

    Parameters
    ----------
    u : (N,), (1, N) or (B, N) float64, optional
        The inputs, if not the experiment's.
    """
    names = [name for name in plant.prior if name not in plant.measured]
    for name in names:
        low, high = plant.prior[name]
        if not low < high:
            raise ValueError(
                f"{name} = {(low, high)} must be a range, low < high. A known parameter has no "
                "posterior; widen its range."
            )
    if len(names) != 2:
        raise ValueError(f"{len(names)} unknown parameters; the quadrature is for two.")
    box = np.stack(plant.ranges)[:, plant.unknown] / plant.width
    truth = theta[:, plant.unknown] / plant.width
    if ((truth < box[0]) | (truth > box[1])).any():
        raise ValueError(
            f"theta has plants outside the prior {dict(plant.prior)}, which the posterior rules "
            "out. Give the plant the prior that they were drawn from."
        )
    root = np.asarray(np.linalg.cholesky(parameter_covariance(plant, theta, u)), dtype=np.float64)
    nodes, weights = hermegauss(_ESTIMATES)
    risk = np.zeros((len(theta), 2, 2))
    for i, j in product(range(_ESTIMATES), repeat=2):
        estimate = truth + root @ np.array([nodes[i], nodes[j]])
        risk += weights[i] * weights[j] * truncated_covariance(estimate, root, *box)
    return spread(metric_slopes(plant, theta), risk / weights.sum() ** 2)


def truncated_covariance(mean: Array, root: Array, low: Array, high: Array) -> Array:
    """Covariance of Gaussians that are cut off at a box, (B, 2, 2).

    With ``x = mean + root w`` the side of the box for x_1 bounds w_1 alone, and given w_1 that
    for x_2 bounds w_2, whose moments over an interval are known.  What is left is an integral
    over w_1, smooth between the points where the bounds of w_2 enter and leave its reach.

    Parameters
    ----------
    mean : (B, 2) float64
        Middle of the whole Gaussians.
    root : (B, 2, 2) float64
        Lower triangular roots of their covariances.
    low, high : (2,) float64
        Sides of the box.
    """
    a, c, d = root[:, 0, 0, None], root[:, 1, 0, None], root[:, 1, 1, None]
    ends = np.clip((np.stack([low, high]) - mean[:, None])[:, :, 0] / a, -_REACH, _REACH)
    sides = (np.stack([low, high]) - mean[:, None])[:, :, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        kinks = np.concatenate([(sides - reach * d) / c for reach in (-_REACH, _REACH)], axis=1)
    kinks = np.clip(np.nan_to_num(kinks), ends[:, :1], ends[:, 1:])
    edges = np.sort(np.concatenate([ends, kinks], axis=1), axis=1)
    nodes, weights = leggauss(_NODES)
    half, middle = np.diff(edges)[..., None] / 2, (edges[:, 1:] + edges[:, :-1])[..., None] / 2
    w = (middle + half * nodes).reshape(len(mean), -1)
    weight = (half * weights).reshape(w.shape) * np.exp(-(w**2) / 2)
    m0, m1, m2 = _moments((sides[:, :1] - c * w) / d, (sides[:, 1:] - c * w) / d)

    def mean_of(values: Array) -> Array:
        return np.asarray((weight * values).sum(axis=1) / (weight * m0).sum(axis=1))

    first = np.stack([mean_of(w * m0), mean_of(m1)], axis=1)
    cross = mean_of(w * m1)
    second = np.array([[mean_of(w * w * m0), cross], [cross, mean_of(m2)]]).transpose(2, 0, 1)
    inner = second - first[:, :, None] * first[:, None, :]
    return np.asarray(root @ inner @ root.swapaxes(1, 2))


def _moments(low: Array, high: Array) -> tuple[Array, Array, Array]:
    """Integrals of 1, w and w^2 times the standard normal density from `low` to `high`."""
    low, high = np.clip(low, -40, 40), np.clip(high, -40, 40)
    at_low, at_high = (np.exp(-(w**2) / 2) / np.sqrt(2 * np.pi) for w in (low, high))
    upper = low + high > 0  # there the difference of the complements has all the digits
    m0 = np.where(upper, ndtr(-low) - ndtr(-high), ndtr(high) - ndtr(low))
    return m0, at_low - at_high, m0 + low * at_low - high * at_high
