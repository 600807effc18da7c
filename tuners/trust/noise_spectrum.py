"""The residual's spectrum, and what coloured noise does to estimates.

Noise is taken as white but for bands around the crossover whose power differs by more than chance.
An estimate by white least squares keeps its value and gets the covariance that such noise gives it
(a sandwich, in the frequency domain); where the colour matters the fit is repeated with each
frequency weighted inversely to the noise there (generalised least squares).
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre import combined, lifted, products
from tuners.trust.black_box import BlackBox, free_responses
from tuners.trust.fast_length import fast_length
from tuners.trust.likely_prior import most_likely
from tuners.trust.octaves import summed

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_BANDS = 2.0 ** np.arange(-4, 4)  # edges, of the crossover: where the noise's power may differ
_COLOURED = 3.0  # standard deviations of a band's power that count as colour
_WEIGHINGS = 3
_TOGETHER = 16  # recordings, whose transforms the cache holds
_NEAR = 0.25, 2.0  # of the crossover: frequencies that decide the response there
_FEW = 14.0  # degrees of freedom left there
_STRONG = 3.0  # times all frequencies' noise: colour that matters there


def sandwich(
    model: BlackBox, error: Array, filtered: Array, crossover: float
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Covariance (B, 2, 2) of noise times signals (B, 2, N), noise spectra, and any colour (B,)."""
    N = error.shape[1]
    length, signals = fast_length(N), model.projected(filtered)
    F = length // 2 + 1
    noisy, spectra = np.empty((len(error), 2, 2)), np.empty((len(error), F))
    coloured, scale = np.empty(len(error), np.bool_), _sides(F) / length
    for k in range(0, len(error), _TOGETHER):
        rows = slice(k, k + _TOGETHER)
        E = np.fft.rfft(error[rows], length)
        X = np.fft.rfft(signals[rows], length)
        spectra[rows], coloured[rows] = spectra_of(
            model, (E.real**2 + E.imag**2) / N, length, crossover
        )
        X = np.concatenate([X.real, X.imag], axis=2)
        weights = np.tile(spectra[rows] * scale, 2)
        noisy[rows] = np.einsum("bif,bf,bjf->bij", X, weights, X)  # no threads of BLAS
    return noisy, spectra, coloured


def weighted(
    model: BlackBox, i: int, spectrum: Array, at: Complex, crossover: float
) -> tuple[Array, Array]:
    """Coefficients (n,) of one recording by weighted least squares, and the covariance (2, 2).

    Each frequency counts inversely to the noise there, whose spectrum is estimated again.  Where
    the fit leaves few degrees of freedom around the crossover, noise can hardly be told from
    response, and the covariance is widened.
    """
    functions, N = model.functions, model.u.shape[1]
    Z, _ = free_responses(functions, N, model.Ts)
    phi = functions.regressors(model.u[i % len(model.u)][None], model.Ts)[0]
    signals = np.concatenate([phi, Z[: model.extra[i]], model.y[i][None]])
    length, n = fast_length(N), len(phi)
    sides = _sides(length // 2 + 1)
    X = _apart(np.fft.rfft(signals, length) * np.sqrt(sides / length))
    near = np.arange(len(sides)) / (length * model.Ts * crossover)
    here = (near > _NEAR[0]) & (near < _NEAR[1])
    band, ends = np.searchsorted(_BANDS, near), X[..., [0, -1]]
    grams, level = _by_bands(X, band), np.ones(len(_BANDS) + 1)
    level[band] = spectrum
    rest, count = [*range(n), -1], np.bincount(band, minlength=len(level))
    for _ in range(_WEIGHINGS):
        gram = np.einsum("kij,k->ij", grams, 1 / level)
        inverse = np.asarray(np.linalg.pinv(gram[n:-1, n:-1], hermitian=True), np.float64)
        apart = np.eye(len(signals))[rest]  # the signals without what the free ones explain
        apart[:, n:-1] = -(inverse @ gram[n:-1][:, rest]).T
        reduced = lifted(apart @ gram @ apart.T)
        found = most_likely(reduced[None, :-1, :-1], reduced[None, :-1, -1], reduced[-1:, -1],
                            np.ones(1))  # fmt: skip
        c = found.coefficients[0]
        weights = (np.append(-c, 1.0) @ apart)[None]
        power = sum(combined(weights, part)[0] ** 2 for part in X) * length / N / sides
        taken = apart[:-1].T @ found.estimator[0] @ apart[:-1]
        taken[n:-1, n:-1] += inverse
        used = np.einsum("kij,ij->k", grams, taken) / 2
        used[band[[0, -1]]] += _leverage(taken, ends) / 2  # each stands for one frequency
        left_here = np.maximum(1 - _leverage(taken, X[..., here]) / 2 / level[band[here]], 0.0)
        level = _levels(power, band, np.maximum(count - used / level, 0.0))
    freedom = max(2 * left_here.sum(), 1.0)
    stronger = level[band[here]].mean() > _STRONG * power.mean() * model.oversampled
    doubt = (1 + (_FEW / freedom) ** 2) ** 2 if stronger else 1.0
    J = response_slopes(c[None], at)
    middle = found.estimator @ reduced[None, :-1, :-1] @ found.estimator + found.hidden
    return c, doubt * (J @ middle @ J.swapaxes(1, 2))[0]


def spectra_of(
    model: BlackBox, power: Array, length: int, crossover: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Noise spectra (B, F) from residuals' power, white but for bands that are not; any colour.

    What the fit has taken from the residual is added again.
    """
    n = model.functions.order
    frequency = np.arange(power.shape[1]) / (length * model.Ts * crossover)
    band = np.searchsorted(_BANDS, frequency)
    count = np.bincount(band, minlength=len(_BANDS) + 1)
    fitted = max(count[:-1].sum(), 1)
    taken = np.where(np.arange(len(count)) < len(_BANDS), 1 - min(n / 2 / fitted, 0.5), 1.0)
    sums = summed(power, band, len(count))
    left = len(frequency) - min(n / 2, len(frequency) / 2)
    overall = sums.sum(axis=1, keepdims=True) / left * model.oversampled
    with np.errstate(divide="ignore", invalid="ignore"):
        level = sums / (count * taken)
        coloured = level > overall * (1 + _COLOURED / np.sqrt(count))
    return np.where(coloured, level, overall)[:, band], coloured[:, :-1].any(axis=1)


def _apart(X: Complex) -> Array:
    """Real and imaginary parts (2, m, F) of transforms (m, F)."""
    return np.stack([X.real, X.imag])


def _by_bands(X: Array, band: NDArray[np.intp]) -> Array:
    """Inner products (bands, m, m) of transforms (2, m, F) in bands of frequencies that follow."""
    grams = np.zeros((len(_BANDS) + 1, X.shape[1], X.shape[1]))
    edges = np.searchsorted(band, np.arange(len(grams) + 1))
    for gram, (first, last) in zip(grams, pairwise(edges), strict=True):
        for part in X[..., first:last]:
            gram += products(part, part)
    return grams


def _levels(power: Array, band: NDArray[np.intp], left: Array) -> Array:
    """Noise in bands by a residual's power (F,), of which a fit has left so many frequencies."""
    sums = np.bincount(band, power, len(left))
    return np.asarray((sums + power.sum() / len(power)) / np.maximum(left - 1, 0.5))


def _leverage(inverse: Array, X: Array) -> Array:
    """What a fit takes from each frequency (F,) of (2, m, F), by its inverse normal matrix."""
    return np.asarray(np.einsum("cif,cif->f", X, inverse @ X))


def _sides(count: int) -> Array:
    """How often each frequency of a real signal's transform stands for: twice but for the ends."""
    sides = np.full(count, 2.0)
    sides[0] = sides[-1] = 1.0
    return sides


def response_slopes(coefficients: Array, at: Complex) -> Array:
    """Derivatives (B, 2, n) of the required log magnitude and phase to the coefficients (B, n)."""
    here = (coefficients @ at)[:, None]
    slopes = np.divide(-at, here, out=np.full(coefficients.shape, np.nan + 0j), where=here != 0)
    return np.stack([slopes.real, slopes.imag], axis=1)
