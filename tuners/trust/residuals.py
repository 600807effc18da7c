"""Structure in the residual of a fitted plant beyond the noise that the plant declares."""

import numpy as np
from numpy.typing import NDArray

from tuners.trust.black_box import BlackBox
from tuners.trust.fit import Fit
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

_CORRELATED = 0.3  # between samples that follow each other: more than chance in a hundred samples
_LARGER = 1.5  # times the declared noise: more than a sensor's tolerance
_DEVIATIONS = 4.0  # of the correlation of white noise


def against_declared(plant: Plant, model: BlackBox, found: Fit) -> tuple[Array, Array]:
    """Residuals over the declared noise, and over the output where noise explains them not, (B,).

    The latter is 0 unless a residual is coloured and larger than declared.  Where the plant's
    noise depends on its output, both are 0: it is then a share of the output, not a number that
    the sensor is known to have.  Samples that were interpolated are left out.  Of several outputs
    the largest counts.
    """
    count, declared = len(found.residual), plant.declared_noise
    if not declared:
        return np.zeros(count), np.zeros(count)
    residual, simulated = (each_output(plant, a) for a in (found.residual, found.simulated))
    residual = residual[:, :: int(np.ceil(model.oversampled))]
    ratio = np.sqrt((residual**2).mean(axis=1)) / declared
    coloured = lag_one(residual) > max(_CORRELATED, _DEVIATIONS / np.sqrt(residual.shape[1]))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.sqrt((residual**2).mean(axis=1) / simulated.var(axis=1))
    pattern = np.where(coloured & (ratio > _LARGER), share, 0.0)
    return ratio.reshape(count, -1).max(axis=1), pattern.reshape(count, -1).max(axis=1)


def each_output(plant: Plant, signals: Array) -> Array:
    """Stacked outputs (B, q N) as rows of their own, (B q, N)."""
    return signals.reshape(len(plant.outputs_named) * len(signals), -1)


def lag_one(residual: Array) -> Array:
    """Correlation (B,) of samples with those before them, about zero."""
    with np.errstate(divide="ignore", invalid="ignore"):
        found = (residual[:, 1:] * residual[:, :-1]).sum(axis=1) / (residual**2).sum(axis=1)
    return np.where(np.isfinite(found), found, 0.0)
