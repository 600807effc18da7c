"""Terms of third degree in a residual: whether a recording's response bends with the amplitude.

Behind a plant that is not linear the linear model explains what it can, and leaves over what bends.
A few terms stand for where the bend may be,

    the output's cube        a sensor that saturates
    the input's, filtered    a steering ratio or a valve that is not constant
    the output's, fed back   tyres that saturate, a damper beyond a threshold
    its square times rate,   what answers more slowly, or more quickly, when it moves far,
    fed back

each without what the linear model explains of it.  What the linear model has explained is taken
from the response: the term's effect is the difference between no amplitude and the recording's.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from tuners.features.laguerre import combined, products
from tuners.trust.black_box import BlackBox
from tuners.trust.noise_spectrum import spectra_of
from yawrate_env.compiled import over_blocks

Array = NDArray[np.float64]

_TERMS = 4
_ROUNDING = 1e-6  # of a term's energy: two levels of a signal, where nothing tells


@dataclass(frozen=True, slots=True, eq=False)
class Curvature:
    """What B recordings say of m terms of third degree.

    Attributes
    ----------
    shifts : NDArray
        (B, m, 2) from the recording's response at the crossover to that of no amplitude, as
        the log magnitude and phase [rad] that a controller must supply.
    sizes : NDArray
        (B, m) how sure that is, in standard deviations; 0 where nothing tells.
    """

    shifts: Array
    sizes: Array

    @property
    def none(self) -> "Curvature":
        """The same recordings without any."""
        return Curvature(np.zeros_like(self.shifts), np.zeros_like(self.sizes))

    @classmethod
    def of(
        cls, model: BlackBox, output: Array, error: Array, slopes: Array, crossover: float
    ) -> "Curvature":
        """Of black boxes' outputs and residuals (B, N).

        Parameters
        ----------
        slopes : (B, 2, n) float64
            Derivatives of what the controller must supply to the coefficients.
        crossover : float
            Around it noise may be coloured [Hz]; what a term explains is no noise.
        """
        B, N = error.shape
        shared = model.functions.regressors(model.u, model.Ts)[0] if len(model.u) == 1 else None
        shifts, sizes = np.zeros((B, _TERMS, 2)), np.zeros((B, _TERMS))
        length = next_fast_len(N, real=True)

        def some(first: int, last: int) -> None:
            for i in range(first, last):
                u = model.u[i % len(model.u)]
                phi = model.functions.regressors(u[None], model.Ts)[0] if shared is None else shared
                terms = _terms(model, i, u, output[i])
                information = model.information[i % len(model.information)]
                seen = model.projected_like(i, terms)
                by = np.linalg.solve(information, products(phi, seen))
                left = model.projected_like(i, terms - combined(by.T, phi))
                energy = (left**2).sum(axis=1)
                tells = energy > _ROUNDING * (terms**2).sum(axis=1)
                size = np.where(tells, left @ error[i], 0.0) / np.where(tells, energy, 1.0)
                E, X = np.split(np.fft.rfft(np.vstack([error[i], left]), length), [1])
                rest = np.abs(E - size[:, None] * X) ** 2 / N
                noise = (
                    2 / length * (np.abs(X) ** 2 * spectra_of(model, rest, length, crossover)[0])
                )
                deviation = np.sqrt(noise.sum(axis=1))
                shifts[i] = -size[:, None] * (slopes[i] @ by).T
                sizes[i] = np.abs(size) * energy / np.where(deviation > 0, deviation, np.inf)

        over_blocks(some, B, 1)
        return cls(shifts, sizes)


def _terms(model: BlackBox, i: int, u: Array, output: Array) -> Array:
    """The terms (m, N) of one recording, each of about the output's size."""

    def answer(signal: Array) -> Array:
        functions = model.functions.regressors(signal[None], model.Ts)[0]
        return np.asarray(combined(model.coefficients[i][None], functions)[0])

    with np.errstate(divide="ignore", invalid="ignore"):
        y, u = (np.nan_to_num(s / np.sqrt((s**2).mean())) for s in (output, u))
    rate = np.gradient(y)
    size = np.sqrt((rate**2).mean())
    swift = y * y * rate / size if size > 0 else rate
    return np.stack([y**3, answer(u**3), answer(y**3), answer(swift)])
