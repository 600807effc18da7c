"""Noise spectra by octaves: white, or stronger toward low frequencies."""

import numpy as np
from numpy.typing import NDArray

from tuners.trust.fast_length import fast_length

Array = NDArray[np.float64]

_COLOURED = 3.0  # standard deviations of a band's power that count as colour
_LOWEST = 2  # bands begin with four frequencies
_ROUNDED = 1e-9  # of white noise's power: no colour
_FEW = 2.0  # times the lowest band's power: what its few frequencies may hide at none


def octaves(power: Array, q: int, noise: Array) -> Array:
    """Spectra (B, F) of residuals' power: white, or of octaves, where one of these is stronger.

    Noise of a low frequency is taken to be at least as strong as that of a high one, since a fit
    of q parameters takes from the residual where the plant responds.
    """
    index = np.maximum(np.arange(power.shape[1]), 1)
    band = np.maximum(np.log2(index).astype(np.intp), _LOWEST - 1) - _LOWEST + 1
    count = np.bincount(band).astype(float)
    sums = summed(power, band, len(count))
    most = noise[:, None] * (1 + _COLOURED / np.sqrt(count))
    white = (sums / count <= most).all(axis=1)
    count[0] -= min(q / 2, count[0] / 2)
    level = np.maximum.accumulate((sums / count)[:, ::-1], axis=1)[:, ::-1]
    return np.where(white[:, None], noise[:, None], level[:, band])


def summed(power: Array, band: NDArray[np.intp], count: int) -> Array:
    """Sums (B, count) of power (B, F) over bands (F,), numbered along the frequencies."""
    found = np.zeros((len(power), count))
    present, first = np.unique(band, return_index=True)
    found[:, present] = np.add.reduceat(power, first, axis=1)
    return found


def energies(signals: Array) -> Array:
    """Energy of signals (..., N) by frequency, (..., F)."""
    X = np.fft.rfft(signals, fast_length(signals.shape[-1]))
    return np.asarray(X.real**2 + X.imag**2)


def along(energy: Array, error: Array, noise: Array) -> Array:
    """Power (B,) of noise with residuals (B, N) along orthonormal signals, at least white's.

    Where it is more, as much more as a band of few frequencies leaves possible.

    Parameters
    ----------
    energy : (m, F) float64
        The signals' `energies`.
    noise : (B,) float64
        Power of white noise with these residuals.
    """
    spectra = octaves(energies(error) / error.shape[1], len(energy), noise)
    weights = energy.sum(axis=0)
    found = np.einsum("bf,f->b", spectra, weights) / weights.sum()
    coloured = found > noise * (1 + _ROUNDED)
    return np.where(coloured, _FEW * found, noise)
