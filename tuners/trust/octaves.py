"""Noise spectra by octaves: white, or stronger toward low frequencies."""

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

Array = NDArray[np.float64]

_COLOURED = 3.0  # standard deviations of a band's power that count as colour
_LOWEST = 2  # bands begin with four frequencies
_ROUNDING = 1e-9
_FEW = 2.0  # times the lowest band's power: what its few frequencies may hide at none


def octaves(power: Array, q: int, noise: Array) -> Array:
    """Spectra (B, F) of residuals' power: white, or of octaves, where one of these is stronger.

    Noise of a low frequency is taken to be at least as strong as that of a high one, since a fit
    of q parameters takes from the residual where the plant responds.
    """
    index = np.maximum(np.arange(power.shape[1]), 1)
    band = np.maximum(np.log2(index).astype(np.intp), _LOWEST - 1) - _LOWEST + 1
    count = np.bincount(band).astype(float)
    sums = np.stack([power[:, band == b].sum(axis=1) for b in range(len(count))], axis=1)
    most = noise[:, None] * (1 + _COLOURED / np.sqrt(count))
    white = (sums / count <= most).all(axis=1)
    count[0] -= min(q / 2, count[0] / 2)
    level = np.maximum.accumulate((sums / count)[:, ::-1], axis=1)[:, ::-1]
    return np.where(white[:, None], noise[:, None], level[:, band])


def energies(signals: Array) -> Array:
    """Energy of signals (m, N) by frequency, (m, F)."""
    return np.asarray(np.abs(np.fft.rfft(signals, next_fast_len(signals.shape[1], real=True))) ** 2)


def along(energy: Array, error: Array, noise: float) -> float:
    """Power of noise with a residual (N,) along orthonormal signals, at least white's.

    Where it is more, as much more as a band of few frequencies leaves possible.

    Parameters
    ----------
    energy : (m, F) float64
        The signals' `energies`.
    noise : float
        Power of white noise with this residual.
    """
    power = np.abs(np.fft.rfft(error, next_fast_len(len(error), real=True))) ** 2 / len(error)
    spectrum = octaves(power[None], len(energy), np.array([noise]))[0]
    weights = energy.sum(axis=0)
    found = float(spectrum @ weights / weights.sum())
    return _FEW * found if found > (1 + _ROUNDING) * noise else noise
