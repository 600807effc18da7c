"""The Cramér-Rao bound on a plant's metrics, by differences.

The Fisher information of the unknown parameters in a recording with white noise of variance
sigma^2 is ``F = sum_k (dy_k/dtheta)(dy_k/dtheta)^T / sigma^2`` (Ljung, *System Identification*,
2nd ed., section 7.4).  A tuner that estimates the parameters without bias, designs with the
estimate and closes the loop around the true plant has metrics of covariance ``J F^-1 J^T`` or
more, with J the derivative of "design for theta', evaluate on theta" to theta' at the truth.
"""

import numpy as np
from numpy.typing import NDArray

from tuners.trust.identification import central, covariance_of, output_slopes
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

PRECISION = 12.0
"""Inverse variance of a uniform density of width one: what a prior knows."""

_SMALLEST = 1e-6  # of a magnitude: where noise in a loop vanishes, nothing is learned either
_STEP = 1e-3  # of a range: metrics may come from a simulation's samples


def cramer_rao(plant: Plant, theta: Array, u: Array | None = None) -> Array:
    """Least standard deviations of the counted metrics (B, f) for plants (B, p).

    Parameters
    ----------
    u : (N,), (1, N) or (B, N) float64, optional
        The inputs, if not the experiment's.
    """
    return spread(metric_slopes(plant, theta), parameter_covariance(plant, theta, u))


def bounds(plant: Plant, theta: Array, u: Array | None = None) -> tuple[Array, Array]:
    """The bound (B, f), and the least of a tuner that knows the prior too, (B, f).

    A uniform prior has the precision 12 in units of its width, which adds to the information
    (van Trees' inequality, for a normal density of the same variance).
    """
    slopes = _whitened(plant, theta, output_slopes(plant, theta, u))
    sigma, J = plant.sigma(plant.answers(theta, u)), metric_slopes(plant, theta)
    variance = sigma[:, None, None] ** 2
    gram = slopes @ slopes.swapaxes(1, 2) + PRECISION * variance * np.eye(slopes.shape[1])
    informed = variance * np.linalg.pinv(gram, hermitian=True)
    return spread(J, covariance_of(slopes, sigma)), spread(J, informed)


def parameter_covariance(plant: Plant, theta: Array, u: Array | None = None) -> Array:
    """Least covariance of the unknown parameters, in widths of their ranges, (B, q, q)."""
    slopes = _whitened(plant, theta, output_slopes(plant, theta, u))
    return covariance_of(slopes, plant.sigma(plant.answers(theta, u)))


def metric_slopes(plant: Plant, theta: Array) -> Array:
    """Derivatives J of the counted metrics to the parameters designed for, (B, f, q)."""
    tiled = np.tile(theta, (2 * len(plant.unknown), 1))
    return central(plant, theta, lambda t: plant.metric_values(tiled, plant.oracle(t)), _STEP)


def spread(J: Array, covariance: Array) -> Array:
    """Standard deviations (B, f) of metrics for parameters with a covariance (B, q, q)."""
    return np.asarray(np.sqrt(np.einsum("bij,bjk,bik->bi", J, covariance, J)))


def _whitened(plant: Plant, theta: Array, slopes: Array) -> Array:
    """Slopes (B, q, N) as white noise of the sensor sees them, where it went round a linear loop.

    What it becomes in the output is ``noise - simulate(theta, noise)``, a filter S; frequencies
    are divided by its magnitude.  (S has zeros at the plant's unstable poles, and no stable
    inverse.)
    """
    if not (plant.in_loop and plant.linear):
        return slopes
    N = slopes.shape[2]
    impulse = np.zeros(N)
    impulse[0] = 1.0
    response = impulse - plant.emulated(impulse).respond(theta, impulse)
    magnitude = np.abs(np.fft.rfft(response, 2 * N))
    least = _SMALLEST * magnitude.max(axis=1, keepdims=True)
    divided = np.fft.rfft(slopes, 2 * N) / np.maximum(magnitude, least)[:, None]
    return np.asarray(np.fft.irfft(divided, 2 * N))
