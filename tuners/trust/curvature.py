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

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from tuners.features.laguerre import combined, lifted, products
from tuners.trust.black_box import BlackBox, free_responses
from tuners.trust.noise_spectrum import spectra_of
from yawrate_env.compiled import LANES, over_blocks

Array = NDArray[np.float64]

_TERMS = 4
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
        shared = _functions(model, 0, size) if len(model.u) == 1 else None
        y, left = averaged(output, size), averaged(error, size)
        (B, N), n = left.shape, model.functions.order
        shifts, sizes = np.zeros((B, _TERMS, 2)), np.zeros((B, _TERMS))
        length = next_fast_len(N, real=True)

        def some(first: int, last: int) -> None:
            for i in range(first, last):
                linear = _functions(model, i, size) if shared is None else shared
                if model.extra[i]:
                    Z, _ = free_responses(model.functions, error.shape[1], model.Ts)
                    linear = np.concatenate([linear, averaged(Z[: model.extra[i]], size)])
                terms = np.stack([averaged(_of_input(model, i), size), *_of_output(slow, i, y[i])])
                signals = np.vstack([left[i], terms])
                gram = lifted(products(linear, linear))
                by = np.asarray(np.linalg.solve(gram, products(linear, signals)), np.float64)
                left_over = signals - combined(by.T, linear)
                rest, bent = left_over[0], left_over[1:]
                energy = (bent**2).sum(axis=1)
                tells = energy > _ROUNDING * (terms**2).sum(axis=1)
                share = np.where(tells, bent @ rest, 0.0) / np.where(tells, energy, 1.0)
                E, X = np.split(np.fft.rfft(np.vstack([rest, bent]), length), [1])
                spectra, _ = spectra_of(
                    slow, np.abs(E - share[:, None] * X) ** 2 / N, length, crossover
                )
                deviation = np.sqrt(2 / length * (np.abs(X) ** 2 * spectra).sum(axis=1))
                shifts[i] = -share[:, None] * (slopes[i] @ by[:n, 1:]).T
                sizes[i] = np.abs(share) * energy / np.where(deviation > 0, deviation, np.inf)

        over_blocks(some, B, LANES)
        return cls(shifts, sizes)


def averaged(signals: Array, size: int) -> Array:
    """Means (..., N // size) of as many samples each."""
    N = signals.shape[-1] // size
    return np.asarray(signals[..., : N * size].reshape(*signals.shape[:-1], N, size).mean(axis=-1))


def _functions(model: BlackBox, i: int, size: int) -> Array:
    """The model's regressors (n, N) of one recording, averaged."""
    u = model.u[[i % len(model.u)]]
    return averaged(model.functions.regressors(u, model.Ts)[0], size)


def _of_input(model: BlackBox, i: int) -> Array:
    """What the model makes of the input's cube, (N,); nothing new of an input of two levels."""
    return _answer(model, i, _scaled(model.u[i % len(model.u)]) ** 3)


def _of_output(model: BlackBox, i: int, output: Array) -> tuple[Array, ...]:
    """The output's cube; the same, and its square times its rate, fed back; (N,) each."""
    y = _scaled(output)
    return y**3, _answer(model, i, y**3), _answer(model, i, y * y * _scaled(np.gradient(y)))


def _answer(model: BlackBox, i: int, signal: Array) -> Array:
    functions = model.functions.regressors(signal[None], model.Ts)[0]
    return np.asarray(combined(model.coefficients[i][None], functions)[0])


def _scaled(signal: Array) -> Array:
    size = np.sqrt((signal**2).mean())
    return np.asarray(signal / size) if size > 0 else signal
