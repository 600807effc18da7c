"""Terms of third degree in a residual: whether a recording's response bends with the amplitude.

Behind a plant that is not linear the linear model explains what it can, and leaves over what bends.
A few terms stand for where the bend may be,

    the input's cube, filtered    a steering ratio or a valve that is not constant
    the output's cube             a sensor that saturates
    the same, fed back            tyres that saturate, a damper beyond a threshold
    its square times its rate,    what answers more slowly, or more quickly, the farther it moves
    fed back

each without what the linear model explains of it.  What the linear model has explained is taken
from the response: the term's effect is the difference between no amplitude and the recording's.
All signals are averaged over samples that follow each other closely.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre import averaged, combined, lifted, products
from tuners.trust.black_box import BlackBox, free_responses
from tuners.trust.fast_length import fast_length
from tuners.trust.noise_spectrum import spectra_of
from yawrate_env.compiled import LANES

Array = NDArray[np.float64]

_TERMS = 4
_TOGETHER = 16  # recordings
_INPUTS = LANES // 2  # which fill the lanes with their cubes
_SAMPLES = 60  # a period of the crossover: as many tell all that bends
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
        size = max(int(1 / (_SAMPLES * crossover * model.Ts)), 1)
        slow = replace(model, Ts=size * model.Ts, oversampled=max(model.oversampled / size, 1.0))
        y, left = averaged(output, size), averaged(error, size)
        (B, N), n = left.shape, model.functions.order
        shifts, sizes = np.zeros((B, _TERMS, 2)), np.zeros((B, _TERMS))
        length, terms = fast_length(N), np.empty((B, _TERMS, N))
        terms[:, 1:] = _of_output(slow, y)
        for own in range(len(model.u)):
            of = np.arange(own, B, len(model.u))
            if own % _INPUTS == 0:
                known = _functions(model, slice(own, own + _INPUTS), size)
            phi, cubed = known[own % _INPUTS]
            terms[of, 0] = combined(model.coefficients[of], cubed)
            for rows, free in _alike(model, of, error.shape[1], size):
                linear = np.concatenate([phi, free])
                signals = np.concatenate([left[rows, None], terms[rows]], axis=1)
                seen = products(linear, signals.reshape(-1, N))
                by = np.asarray(np.linalg.solve(lifted(products(linear, linear)), seen), np.float64)
                rest = signals - combined(by.T, linear).reshape(signals.shape)
                rest, bent = rest[:, 0], rest[:, 1:]
                energy = (bent**2).sum(axis=2)
                tells = energy > _ROUNDING * (terms[rows] ** 2).sum(axis=2)
                along = np.einsum("bmn,bn->bm", bent, rest)
                share = np.where(tells, along, 0.0) / np.where(tells, energy, 1.0)
                E, X = np.fft.rfft(rest, length)[:, None], np.fft.rfft(bent, length)
                power = np.abs(E - share[..., None] * X) ** 2 / N
                spectra, _ = spectra_of(
                    slow, power.reshape(len(rows) * _TERMS, -1), length, crossover
                )
                noisy = (np.abs(X) ** 2 * spectra.reshape(X.shape)).sum(axis=2)
                deviation = np.sqrt(2 / length * noisy)
                shifts[rows] = -share[..., None] * np.einsum(
                    "bin,nbm->bmi", slopes[rows], by[:n].reshape(n, len(rows), -1)[..., 1:]
                )
                sizes[rows] = np.abs(share) * energy / np.where(deviation > 0, deviation, np.inf)
        return cls(shifts, sizes)


def _alike(
    model: BlackBox, of: NDArray[np.intp], N: int, size: int
) -> Iterator[tuple[NDArray[np.intp], Array]]:
    """Some recordings at a time with as many free responses, and these, averaged."""
    for count in np.unique(model.extra[of]).tolist():
        free = np.empty((0, N // size))
        if count:
            free = averaged(free_responses(model.functions, N, model.Ts)[0][:count], size)
        same = of[model.extra[of] == count]
        for rows in np.split(same, range(_TOGETHER, len(same), _TOGETHER)):
            yield rows, free


def _functions(model: BlackBox, inputs: slice, size: int) -> Array:
    """The model's regressors (E, 2, n, N) of some inputs, and of their cubes, averaged.

    The cube is nothing new of an input of two levels.
    """
    u = model.u[inputs]
    signals = np.stack([u, _scaled(u) ** 3], axis=1).reshape(-1, u.shape[1])
    found = model.functions.averages(signals, model.Ts, size)
    return found.reshape(len(u), 2, *found.shape[1:])


def _of_output(model: BlackBox, output: Array) -> Array:
    """Cubes of outputs (B, N); the same, and squares times rates, fed back; (B, 3, N)."""
    y = _scaled(output)
    cube, lag = y**3, y * y * _scaled(np.gradient(y, axis=1))
    fed, weights = np.concatenate([cube, lag]), np.tile(model.coefficients, (2, 1))
    back = model.functions.outputs(fed, weights[:, None], model.Ts)[:, 0]
    return np.stack([cube, *np.split(back, 2)], axis=1)


def _scaled(signal: Array) -> Array:
    size = np.sqrt((signal**2).mean(axis=-1, keepdims=True))
    return np.asarray(signal / np.where(size > 0, size, 1.0))
