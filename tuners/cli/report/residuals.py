"""Whiteness of a fit's residuals, and how much of them an input explains.

For a right model the residual's autocorrelation at lag k > 0 and its cross-correlation with
an input are normal around zero, with standard deviations 1/sqrt(N) and
sqrt(sum_k r_e(k) r_u(k) / N) (Ljung, *System Identification*, 2nd ed., section 16.6).
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NORMAL_99 = 2.576


@dataclass(frozen=True, slots=True, eq=False)
class Correlation:
    """A correlation function and the band that 99 % of it should keep to.

    Attributes
    ----------
    lag : NDArray
        (K,) [s].
    value : NDArray
        (K,) normalised.
    band : float
        Half its width.
    """

    lag: Array
    value: Array
    band: float

    @property
    def outside(self) -> float:
        """Share of the lags outside the band; lag 0 of an autocorrelation does not count."""
        inner = self.value < 1 - 1e-9
        return float(np.mean(np.abs(self.value[inner]) > self.band)) if inner.any() else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """Correlations of residuals at the recording's own sampling time.

    Attributes
    ----------
    auto : tuple of Correlation
        Of each of q residuals with itself.
    cross : tuple of tuple of Correlation
        Of each with each of m inputs.
    """

    auto: tuple[Correlation, ...]
    cross: tuple[tuple[Correlation, ...], ...]

    @classmethod
    def of(cls, e: Array, u: Array, Ts: float, recorded: float, longest: float) -> Self:
        """Correlations of the recorded samples, without those interpolated between them.

        Parameters
        ----------
        e, u : (N,) float64
            Residual and input, of several channels (q, N) and (m, N).
        Ts, recorded : float
            Sampling times of these, and of the recording [s].
        longest : float
            Largest lag [s].
        """
        every = max(1, round(recorded / Ts))
        left, inputs, Ts = np.atleast_2d(e)[:, ::every], np.atleast_2d(u)[:, ::every], every * Ts
        return cls(
            tuple(autocorrelation(row, Ts, longest) for row in left),
            tuple(
                tuple(cross_correlation(row, each, Ts, longest) for each in inputs) for row in left
            ),
        )

    @property
    def outside(self) -> tuple[float, float]:
        """Mean shares of the lags outside the bands: with themselves, and with inputs."""
        every = self.auto, [each for row in self.cross for each in row]
        own, others = (float(np.mean([each.outside for each in found])) for found in every)
        return own, others


def autocorrelation(e: Array, Ts: float, longest: float) -> Correlation:
    """Of a residual (N,), at lags 0 to `longest` [s]."""
    count = _lags(e, Ts, longest)
    value = _correlated(e, e)[: count + 1]
    return Correlation(
        Ts * np.arange(count + 1, dtype=np.float64), value, NORMAL_99 / float(np.sqrt(len(e)))
    )


def cross_correlation(e: Array, u: Array, Ts: float, longest: float) -> Correlation:
    """Of a residual with an input, both (N,), at lags -`longest` to `longest` [s].

    A positive lag is the residual after the input.
    """
    count = _lags(e, Ts, longest)
    forward, backward = _correlated(e, u), _correlated(u, e)
    value = np.concatenate([backward[count:0:-1], forward[: count + 1]])
    M = len(e) // 4  # further lags of the autocorrelations are mostly noise
    r_e, r_u = _correlated(e, e)[:M], _correlated(u, u)[:M]
    variance = max(2 * float(r_e @ r_u) - 1.0, 0.0) / len(e)  # both sides, lag 0 once
    return Correlation(
        Ts * np.arange(-count, count + 1, dtype=np.float64),
        value,
        NORMAL_99 * float(np.sqrt(variance)),
    )


def _lags(e: Array, Ts: float, longest: float) -> int:
    return min(round(longest / Ts), len(e) // 4)


def _correlated(a: Array, b: Array) -> Array:
    """Normalised sum_n a[n + k] b[n], k = 0 to N - 1, means removed."""
    a, b = a - a.mean(), b - b.mean()
    size = 2 * len(a)
    product = np.fft.irfft(np.fft.rfft(a, size) * np.conj(np.fft.rfft(b, size)), size)
    scale = np.sqrt((a @ a) * (b @ b))
    return np.asarray(product[: len(a)] / (scale if scale > 0 else 1.0))
