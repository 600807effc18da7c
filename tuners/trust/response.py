"""The response that a recording shows at the crossover, and the gains that it asks for.

The black box's coefficients are estimated again, drawn to a smooth response:  with the prior
``c_i ~ N(0, s a^i)`` on the Laguerre coefficients, scale and decay are those under which the
recording is most likely (empirical Bayes; Pillonetto and De Nicolao, 2010; Chen, Ohlsson and
Ljung, 2012).  So the data choose the order.  The response at the crossover then has gains in
closed form, by the design rule.  Nothing of the simulator is used.

The covariance holds for coloured noise too: with ``x`` the input through the filter that turns
outputs into the estimate, it is the sum over frequencies of ``|X|^2`` times the residual's
spectrum (a sandwich, in the frequency domain), and the part of the response that the prior hides.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from tuners.features.laguerre import Laguerre
from tuners.trust.black_box import BlackBox
from yawrate_env.loop import controller
from yawrate_env.loop.design import Status, design_from_response
from yawrate_env.loop.margins import delta_operator
from yawrate_env.loop.target import Target

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_DECAYS = (0.5, 0.65, 0.8, 0.9, 1.0)
_SCALES = np.geomspace(1e-3, 1e3, 13)
_LOWEST, _HIGHEST, _POINTS = 1 / 30, 3.5, 256  # of the crossover, and frequencies between
_NYQUIST = 0.95  # of half the controller's rate: the highest frequency that is looked at
_BANDS = 2.0 ** np.arange(-4, 4)  # edges, of the crossover: where the noise's power may differ
_COLOURED = 2.0  # standard deviations of a band's power that count as colour


@dataclass(frozen=True, slots=True, eq=False)
class Regularised:
    """Black boxes of B recordings, drawn to smooth responses.

    Attributes
    ----------
    coefficients : NDArray
        (B, n) on the functions.
    estimator : NDArray
        (B, n, n) by which inner products of functions and output become coefficients.
    hidden : NDArray
        (B, n, n) part of it that is the prior's: what the recording does not show.
    """

    coefficients: Array
    estimator: Array
    hidden: Array


def regularised(model: BlackBox) -> Regularised:
    """Estimate the coefficients of black boxes again, with the most likely prior."""
    (B, n), G = model.coefficients.shape, model.information
    right = (G @ model.coefficients[..., None])[..., 0]
    independent = model.u.shape[1] / model.oversampled - n
    variance = np.maximum(model.residual / model.u.shape[1], 1e-300)
    variance = variance * model.oversampled * (1 + n / max(independent, 1.0))
    energy = model.residual + (right * model.coefficients).sum(axis=1)
    trace = np.einsum("bii->b", G)
    size = energy / np.where(trace > 0, trace, 1.0) * n
    least, found = np.full(B, np.inf), [np.zeros((B, n)), np.zeros((B, n, n)), np.zeros((B, n, n))]
    for decay in _DECAYS:
        root = np.sqrt(size)[:, None] * decay ** (np.arange(n) / 2)
        values, vectors = np.linalg.eigh(root[:, :, None] * G * root[:, None, :])
        values = np.maximum(values, 0.0)
        turned = ((root * right)[:, None] @ vectors)[:, 0]
        scaled = _SCALES[:, None, None] * values + variance[:, None]
        cost = (energy - (_SCALES[:, None, None] * turned**2 / scaled).sum(axis=2)) / variance
        cost = cost + np.log(scaled / variance[:, None]).sum(axis=2)
        best = cost.argmin(axis=0)
        cost, scale = cost[best, np.arange(B)], _SCALES[best][:, None]
        better = cost < least
        if not better.any():
            continue
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
    return Regularised(*found)


@dataclass(frozen=True, eq=False)
class Response:
    """What B recordings say of the plant around the crossover, as the controller sees it.

    Attributes
    ----------
    target : Target
        Of the loop.
    omega : NDArray
        (F,) frequencies [rad/s], evenly spaced in their logarithm.
    values : NDArray
        (B, F) complex128, the plant's response, the loop's delay in it.
    required : NDArray
        (B, 2) log magnitude and phase [rad] that the controller must supply.
    covariance : NDArray
        (B, 2, 2) of `required`.
    noise : NDArray
        (B,) mean square of the black box's residual.
    """

    target: Target
    omega: Array
    values: Complex
    required: Array
    covariance: Array
    noise: Array

    @classmethod
    def of(cls, model: BlackBox, target: Target) -> "Response":
        """Response of black boxes at the target's crossover, regularised."""
        found, omega = regularised(model), _frequencies(target)
        seen = _functions_seen(model.functions, model.Ts, target)
        at, values = seen[:, -1], found.coefficients @ seen[:, :-1]
        here = found.coefficients @ at
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes = -at / here[:, None]
            J = np.stack([slopes.real, slopes.imag], axis=1)
            phase = _phase_at(omega, values, here, target.omega_c)
            log_magnitude = -np.log(np.abs(here))
        needed = np.radians(target.phase_margin) - np.pi - phase
        noise, covariance = _sandwich(model, found, J, target.crossover)
        return cls(target, omega, values, np.stack([log_magnitude, needed], axis=1), covariance,
                   noise)  # fmt: skip

    def __len__(self) -> int:
        return len(self.values)

    @cached_property
    def gains(self) -> Array:
        """(B, 2) gains of the design rule; ``nan`` where no controller comes near the target."""
        found = design_from_response(*self.required.T, self.target)
        return np.stack([found.kp, found.Ti], axis=1)

    @property
    def within_reach(self) -> NDArray[np.bool_]:
        """(B,) whether the controller reaches the target."""
        found = design_from_response(*self.required.T, self.target)
        return np.asarray(found.status == Status.OK)

    @cached_property
    def reached(self) -> Array:
        """(B, 2) metrics of `gains`; the target where there are none."""
        target = np.array([self.target.phase_margin, self.target.crossover])
        metrics = self.metrics(self.gains)
        return np.where(np.isfinite(metrics).all(axis=1, keepdims=True), metrics, target)

    def spread(self, gains: Array) -> Array:
        """Standard deviations (B, 2) of the `metrics` of gains (B, 2)."""
        with np.errstate(invalid="ignore"):
            return np.asarray(np.sqrt(np.einsum("bii->bi", self.metric_covariance(gains))))

    def metrics(self, gains: Array) -> Array:
        """Phase margin [deg] and crossover [Hz] (B, 2) that gains (B, 2) reach; else ``nan``."""
        return self._crossing(gains)[0]

    def metric_covariance(self, gains: Array) -> Array:
        """Covariance (B, 2, 2) of the `metrics` of gains (B, 2); ``nan`` where there are none."""
        metrics, (magnitude, phase) = self._crossing(gains)
        with np.errstate(divide="ignore", invalid="ignore"):
            J = np.zeros((len(self), 2, 2))
            J[:, 0, 0], J[:, 0, 1] = np.degrees(phase / magnitude), -np.degrees(1.0)
            J[:, 1, 0] = metrics[:, 1] / magnitude
            return np.asarray(J @ self.covariance @ J.swapaxes(1, 2))

    def _crossing(self, gains: Array) -> tuple[Array, tuple[Array, Array]]:
        """Metrics, and the slopes of log magnitude and phase over log frequency, (B,) each."""
        target, log_omega = self.target, np.log(self.omega)
        n1, n0, d0 = (c[:, None] for c in controller.coefficients(*gains.T, target))
        delta = delta_operator(self.omega, target.Ts)
        with np.errstate(divide="ignore", invalid="ignore"):
            L = self.values * (n1 * delta + n0) / (delta + d0)
            magnitude, phase = np.log(np.abs(L)), np.unwrap(np.angle(L), axis=1)
            falls = (magnitude[:, :-1] > 0) & (magnitude[:, 1:] <= 0)
            k = falls.shape[1] - 1 - falls[:, ::-1].argmax(axis=1)
            rows, width = np.arange(len(L)), log_omega[k + 1] - log_omega[k]
            before, after = magnitude[rows, k], magnitude[rows, k + 1]
            share = np.where(falls.any(axis=1), before / (before - after), np.nan)
            turn = phase[rows, k + 1] - phase[rows, k]
            margin = np.degrees(phase[rows, k] + share * turn) + 180
            omega = np.exp(log_omega[k] + share * width)
        margin = (margin + 180) % 360 - 180
        metrics = np.stack([margin, omega / (2 * np.pi)], axis=1)
        return metrics, ((after - before) / width, turn / width)


def _sandwich(
    model: BlackBox, found: Regularised, J: Array, crossover: float
) -> tuple[Array, Array]:
    """Noise (B,), and covariance (B, 2, 2) of what depends by J (B, 2, n) on the coefficients."""
    N = model.u.shape[1]
    weights = np.concatenate([model.coefficients[:, None], J @ found.estimator], axis=1)
    signals = model.functions.outputs(model.u, weights, model.Ts)
    error, filtered = model.y - signals[:, 0], model.projected(signals[:, 1:])
    length = next_fast_len(N, real=True)
    transformed = np.fft.rfft(np.concatenate([error[:, None], filtered], axis=1), length)
    E, X = transformed[:, 0], transformed[:, 1:]
    spectrum = _spectrum(model, (E * E.conj()).real / N, length, crossover)
    twice = np.full(X.shape[2], 2.0)
    twice[0] = twice[-1] = 1.0
    noisy = ((X * (spectrum * twice)[:, None]) @ X.conj().swapaxes(1, 2)).real / length
    return (error**2).mean(axis=1), noisy + J @ found.hidden @ J.swapaxes(1, 2)


def _spectrum(model: BlackBox, power: Array, length: int, crossover: float) -> Array:
    """Spectrum of the noise (B, F) from the residual's power: white but for bands that are not.

    What the fit has taken from the residual is added again.
    """
    n = model.functions.order
    frequency = np.arange(power.shape[1]) / (length * model.Ts * crossover)
    band = np.searchsorted(_BANDS, frequency)
    count = np.bincount(band, minlength=len(_BANDS) + 1)
    fitted = max(count[:-1].sum(), 1)
    taken = np.where(np.arange(len(count)) < len(_BANDS), 1 - min(n / 2 / fitted, 0.5), 1.0)
    sums = np.stack([power[:, band == b].sum(axis=1) for b in range(len(count))], axis=1)
    overall = sums.sum(axis=1, keepdims=True) / (len(frequency) - min(n / 2, len(frequency) / 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        level = sums / (count * taken)
        coloured = level > overall * (1 + _COLOURED / np.sqrt(count))
    return np.asarray(np.where(coloured, level, overall)[:, band])


def _frequencies(target: Target) -> Array:
    highest = min(_HIGHEST, _NYQUIST / (2 * target.crossover * target.Ts))
    return np.asarray(np.geomspace(_LOWEST, max(highest, 1.0), _POINTS) * target.omega_c)


@lru_cache(maxsize=8)
def _functions_seen(functions: Laguerre, Ts: float, target: Target) -> Complex:
    """Responses (n, F + 1) of the functions as the controller sees them; last at the crossover."""
    omega = np.append(_frequencies(target), target.omega_c)
    lag = np.exp(-1j * omega * target.delay_samples * target.Ts)
    return np.asarray(functions.held_response(omega, Ts, target.Ts) * lag)


def _phase_at(omega: Array, values: Complex, here: Complex, omega_c: float) -> Array:
    """Phase (B,) at the crossover, followed from low frequency [rad]."""
    below = omega < omega_c
    angle = np.angle(np.concatenate([values[:, below], here[:, None]], axis=1))
    angle[:, 0] -= 2 * np.pi * (angle[:, 0] > np.pi / 2)
    return np.asarray(np.unwrap(angle, axis=1)[:, -1])
