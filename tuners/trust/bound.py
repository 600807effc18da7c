"""The Cramér-Rao bound on a loop's metrics, by differences.

The Fisher information of the parameters in an episode with white noise of variance sigma^2 is
``F = sum_k (dy_k/dtheta)(dy_k/dtheta)^T / sigma^2`` (Ljung, *System Identification*, 2nd ed.,
section 7.4).  An unbiased estimate of theta, used for the design and evaluated on the true plant,
gives metrics with a covariance of at least ``J F^-1 J^T``, J being the derivative of "design with
theta', evaluate with theta" with respect to theta' at the truth.
"""

import numpy as np
from numpy.typing import NDArray

from tuners.trust.identification import central, covariance_of, output_slopes
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

_STEP = 1e-3  # of a range: metrics may come from a simulation's samples


def parameter_covariance(plant: Plant, theta: Array, u: Array | None = None) -> Array:
    """Least covariance of the unknown parameters, in widths of their ranges, (B, q, q).

    Parameters
    ----------
    u : (N,), (1, N) or (B, N) float64, optional
        The inputs, if not the experiment's.
    """
    slopes = output_slopes(plant, theta, u)
    return covariance_of(slopes, plant.sigma(plant.respond(theta, u)))


def cramer_rao(plant: Plant, theta: Array, u: Array | None = None) -> Array:
    """Least standard deviations of the counted metrics (B, f) for plants (B, p); `u` as above."""
    tiled = np.tile(theta, (2 * len(plant.unknown), 1))
    J = central(plant, theta, lambda t: plant.metric_values(tiled, plant.oracle(t)), _STEP)
    variance = np.einsum("bij,bjk,bik->bi", J, parameter_covariance(plant, theta, u), J)
    return np.asarray(np.sqrt(variance))
