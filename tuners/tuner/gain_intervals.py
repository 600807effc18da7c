"""Intervals of the gains themselves, by the delta method."""

import numpy as np
from numpy.typing import NDArray

from tuners.trust.checks import Assessment
from tuners.trust.identification import central
from tuners.trust.intervals import GAUSSIAN, Interval
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

_STEP = 1e-5  # of log magnitude and rad
_OF_RANGE = 1e-3  # of a parameter's range


def gain_intervals(
    plant: Plant, gains: Array, found: Assessment, i: int, factor: float = GAUSSIAN
) -> dict[str, Interval]:
    """Gains (k,) plus and minus `factor` standard deviations, as far as recordings tell.

    Where their own response judges, what it asks of the controller varies with its covariance;
    elsewhere the fitted plant does, and the design rule's gains with it.
    """
    response = found.response
    if response is None:
        return exact_gain_intervals(plant, gains, found, i, factor)
    with np.errstate(all="ignore"):
        J = _decoding(plant, gains)
        covariance = J @ response.covariance[i] @ J.T
    return _around(plant, gains, covariance, factor)


def exact_gain_intervals(
    plant: Plant,
    gains: Array,
    found: Assessment,
    i: int,
    factor: float = GAUSSIAN,
    slopes: Array | None = None,
) -> dict[str, Interval]:
    """The same if the plant's data are exact but for the parameters that are estimated.

    `slopes` are the `design_slopes` at all recordings' parameters, where these are known.
    """
    fit = found.fit
    covariance = fit.covariance[i]
    if fit.discrepancy is not None:
        covariance = fit.discrepancy.covariance[i]
    theta = fit.theta[[i]]
    if not (np.isfinite(theta).all() and np.isfinite(covariance).all()):
        return _around(plant, gains, np.full((len(gains), len(gains)), np.nan), factor)
    J = (design_slopes(plant, theta) if slopes is None else slopes[[i]])[0]
    with np.errstate(all="ignore"):
        return _around(plant, gains, J @ covariance @ J.T, factor)


def design_slopes(plant: Plant, theta: Array) -> Array:
    """Derivatives (B, k, q) of the design rule's gains to the unknown parameters in widths."""
    found = np.full((len(theta), len(plant.gains), len(plant.unknown)), np.nan)
    known = np.flatnonzero(np.isfinite(theta).all(axis=1))
    try:
        found[known] = central(plant, theta[known], plant.oracle, _OF_RANGE)
    except ValueError:  # a plant's own design rule may refuse a neighbour
        if len(known) > 1:
            found[known] = np.concatenate([design_slopes(plant, theta[[i]]) for i in known])
    return found


def _around(plant: Plant, gains: Array, covariance: Array, factor: float) -> dict[str, Interval]:
    with np.errstate(invalid="ignore"):
        half = factor * np.sqrt(np.diag(covariance))
    ends = zip(plant.gains, gains, half, strict=True)
    return {name: Interval(float(v), float(v - h), float(v + h)) for name, v, h in ends}


def _decoding(plant: Plant, gains: Array) -> Array:
    """Derivatives (k, 2) of gains to the coordinates that the parametrisation gives them."""
    encode, decode = plant.parametrisation.encode, plant.parametrisation.decode
    at = encode(gains[None])
    offsets = _STEP * np.concatenate([np.eye(at.shape[1]), -np.eye(at.shape[1])])
    values = decode(at + offsets)
    half = len(values) // 2
    return np.asarray((values[:half] - values[half:]).T / (2 * _STEP))
