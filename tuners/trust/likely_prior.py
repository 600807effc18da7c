"""Least squares drawn to a smooth response, by the prior under which the data are most likely.

With the prior ``c_i ~ N(0, s a^i)`` on Laguerre coefficients, scale and decay maximise the marginal
likelihood (empirical Bayes; Pillonetto and De Nicolao, 2010; Chen, Ohlsson and Ljung, 2012): the
data choose the order.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.trust.black_box import BlackBox

Array = NDArray[np.float64]

_DECAYS = (0.5, 0.65, 0.8, 0.9, 1.0)
_SCALES = np.geomspace(1e-3, 1e3, 13)
_LEAST = 1e-20  # of the output's energy: noise below rounding


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Coefficients of B recordings, drawn to smooth responses.

    Attributes
    ----------
    coefficients : NDArray
        (B, n) on the functions.
    estimator : NDArray
        (B, n, n) by which inner products of functions and output become coefficients.
    hidden : NDArray
        (B, n, n) covariance of what the prior hides: what the recording does not show.
    """

    coefficients: Array
    estimator: Array
    hidden: Array


def most_likely(gram: Array, right: Array, energy: Array, variance: Array) -> Estimate:
    """Coefficients of B least-squares problems with the most likely prior.

    Parameters
    ----------
    gram, right, energy : (B, n, n), (B, n), (B,) float64
        Inner products of the functions, of functions and output, and of the output.  An energy
        that rounding leaves negative, as of a loop that ran away, gives coefficients of zero.
    variance : (B,) float64
        Of the noise.
    """
    B, n = right.shape
    trace = np.einsum("bii->b", gram)
    size = np.maximum(energy, 0.0) / np.where(trace > 0, trace, 1.0) * n
    least, found = np.full(B, np.inf), [np.zeros((B, n)), np.zeros((B, n, n)), np.zeros((B, n, n))]
    for decay in _DECAYS:
        root = np.sqrt(size)[:, None] * decay ** (np.arange(n) / 2)
        values, vectors = np.linalg.eigh(root[:, :, None] * gram * root[:, None, :])
        values = np.maximum(values, 0.0)
        turned = ((root * right)[:, None] @ vectors)[:, 0]
        scaled = _SCALES[:, None, None] * values + variance[:, None]
        cost = (energy - (_SCALES[:, None, None] * turned**2 / scaled).sum(axis=2)) / variance
        cost = cost + np.log(scaled / variance[:, None]).sum(axis=2)
        best = cost.argmin(axis=0)
        cost, scale = cost[best, np.arange(B)], _SCALES[best][:, None]
        better = cost < least
        least = np.where(better, cost, least)
        shrunk = scale / (scale * values + variance[:, None])
        V = root[:, :, None] * vectors
        parts = (
            (V @ (shrunk * turned)[..., None])[..., 0],
            (V * shrunk[:, None]) @ V.swapaxes(1, 2),
            (V * (variance[:, None] ** 2 * shrunk**2 / scale)[:, None]) @ V.swapaxes(1, 2),
        )
        for total, part in zip(found, parts, strict=True):
            total[better] = part[better]
    return Estimate(*found)


def from_white(model: BlackBox) -> Estimate:
    """Coefficients of black boxes, whose residual is taken for white noise."""
    right, energy = _products(model)
    return most_likely(model.information, right, energy, white_variance(model))


def _products(model: BlackBox) -> tuple[Array, Array]:
    """Inner products of functions and output (B, n), and of the output (B,)."""
    right = (model.information @ model.coefficients[..., None])[..., 0]
    return right, model.residual + (right * model.coefficients).sum(axis=1)


def white_variance(model: BlackBox) -> Array:
    """Variance (B,) of the noise, taken for white."""
    n, N = model.functions.order, model.u.shape[1]
    _, energy = _products(model)
    independent = max(N / model.oversampled - n, 1.0)
    least = np.where(energy > 0, _LEAST * energy, 1.0)
    return np.asarray(
        np.maximum(model.residual, least) / N * model.oversampled * (1 + n / independent)
    )
