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

from tuners.features.laguerre import Laguerre, combined, lifted, products
from tuners.trust.black_box import BlackBox, free_responses
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
_COLOURED = 3.0  # standard deviations of a band's power that count as colour
_WEIGHINGS = 3
_NEAR = 0.25, 2.0  # of the crossover: frequencies that decide the response there
_FEW = 14.0  # degrees of freedom left there
_LEAST = 1e-20  # of the output's energy: noise below rounding
_ROUNDING = 1e-6  # of the cube's energy
_STRONG = 3.0  # times all frequencies' noise: colour that matters there


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


def regularised(gram: Array, right: Array, energy: Array, variance: Array) -> Regularised:
    """Coefficients of B least-squares problems with the most likely prior.

    Parameters
    ----------
    gram, right, energy : (B, n, n), (B, n), (B,) float64
        Inner products of the functions, of functions and output, and of the output.
    variance : (B,) float64
        Of the noise.
    """
    B, n = right.shape
    trace = np.einsum("bii->b", gram)
    size = energy / np.where(trace > 0, trace, 1.0) * n
    least, found = np.full(B, np.inf), [np.zeros((B, n)), np.zeros((B, n, n)), np.zeros((B, n, n))]
    for decay in _DECAYS:
        root = np.sqrt(size)[:, None] * decay ** (np.arange(n) / 2)
        values, vectors = np.linalg.eigh(root[:, :, None] * gram * root[:, None, :])
        values = np.maximum(values, 0.0)
        turned = ((root * right)[:, None] @ vectors)[:, 0]
        scaled = _SCALES[:, None, None] * values + variance[:, None]
        cost = (energy - (_SCALES[:, None, None] * turned**2 / scaled).sum(axis=2)) / variance
        cost = cost + np.log(scaled / variance[:, None]).sum(axis=2)
        best = cost.argmin(axis=0)
        cost, scale = cost[best, np.arange(B)], _SCALES[best][:, None]
        better = cost < least
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


def _from_white(model: BlackBox) -> Regularised:
    """Coefficients of black boxes, whose residual is taken for white noise."""
    n, N = model.functions.order, model.u.shape[1]
    right = (model.information @ model.coefficients[..., None])[..., 0]
    energy = model.residual + (right * model.coefficients).sum(axis=1)
    independent = max(N / model.oversampled - n, 1.0)
    least = np.where(energy > 0, _LEAST * energy, 1.0)
    variance = np.maximum(model.residual, least) / N * model.oversampled * (1 + n / independent)
    return regularised(model.information, right, energy, variance)


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
    colour : NDArray
        (B,) power of the residual around the crossover over that of white noise.
    halves : NDArray
        (B, 2) by how much the second half of the recording asks for another `required`.
    bend : NDArray
        (B,) by which share the response grows, or shrinks if negative, from no amplitude to the
        recording's: what a cube of the output explains of the residual.
    doubt : NDArray
        (B,) standard deviation of `bend`.
    """

    target: Target
    omega: Array
    values: Complex
    required: Array
    covariance: Array
    noise: Array
    colour: Array
    halves: Array
    bend: Array
    doubt: Array

    @classmethod
    def of(cls, model: BlackBox, target: Target) -> "Response":
        """Response of black boxes at the target's crossover, regularised."""
        found, omega = _from_white(model), _frequencies(target)
        seen = _functions_seen(model.functions, model.Ts, target)
        at, values = seen[:, -1], seen[:, :-1]
        J = _slopes(found.coefficients, at)
        weights = np.concatenate([model.coefficients[:, None], J @ found.estimator], axis=1)
        signals = model.functions.outputs(model.u, weights, model.Ts)
        output, error = signals[:, 0], model.y - signals[:, 0]
        covariance, spectra, coloured = _sandwich(model, error, signals[:, 1:], target.crossover)
        covariance += J @ found.hidden @ J.swapaxes(1, 2)
        halves, bent = _halves(model, error, J @ found.estimator), _bend(model, output, error)
        for i in np.flatnonzero(coloured):
            found.coefficients[i], covariance[i] = _weighted(model, i, spectra[i], at, target)
        values, here = found.coefficients @ values, found.coefficients @ at
        with np.errstate(divide="ignore", invalid="ignore"):
            phase = _phase_at(omega, values, here, target.omega_c)
            log_magnitude = -np.log(np.abs(here))
        needed = np.radians(target.phase_margin) - np.pi - phase
        required = np.stack([log_magnitude, needed], axis=1)
        noise = (error**2).mean(axis=1)
        at_crossover = round(2 * (spectra.shape[1] - 1) * model.Ts * target.crossover)
        colour = spectra[:, at_crossover] / np.where(noise > 0, noise, 1.0) / model.oversampled
        return cls(target, omega, values, required, covariance, noise, colour, halves, *bent)

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

    def moved(self, gains: Array) -> tuple[Array, Array]:
        """Metrics (B, 2) by which gains differ between halves, and in standard deviations (B,).

        Half of it is how far either is from the whole.
        """
        J = self._metric_slopes(gains)
        with np.errstate(invalid="ignore"):
            difference = (J @ self.halves[..., None])[..., 0]
            covariance = 4 * J @ self.covariance @ J.swapaxes(1, 2)
            regular = np.isfinite(covariance).all(axis=(1, 2))[:, None, None]
            covariance = np.where(regular, covariance, np.eye(2))
            weighted = np.linalg.solve(covariance, difference[..., None])[..., 0]
            return np.abs(difference) / 2, np.sqrt((difference * weighted).sum(axis=1))

    def metric_covariance(self, gains: Array) -> Array:
        """Covariance (B, 2, 2) of the `metrics` of gains (B, 2); ``nan`` where there are none."""
        J = self._metric_slopes(gains)
        return np.asarray(J @ self.covariance @ J.swapaxes(1, 2))

    def _metric_slopes(self, gains: Array) -> Array:
        """Derivatives (B, 2, 2) of the `metrics` of gains (B, 2) to `required`."""
        metrics, (magnitude, phase) = self._crossing(gains)
        J = np.zeros((len(self), 2, 2))
        with np.errstate(divide="ignore", invalid="ignore"):
            J[:, 0, 0], J[:, 0, 1] = np.degrees(phase / magnitude), -np.degrees(1.0)
            J[:, 1, 0] = metrics[:, 1] / magnitude
        return J

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


def _slopes(coefficients: Array, at: Complex) -> Array:
    """Derivatives (B, 2, n) of the required log magnitude and phase to the coefficients (B, n)."""
    here = (coefficients @ at)[:, None]
    slopes = np.divide(-at, here, out=np.full(coefficients.shape, np.nan + 0j), where=here != 0)
    return np.stack([slopes.real, slopes.imag], axis=1)


def _sandwich(
    model: BlackBox, error: Array, filtered: Array, crossover: float
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Covariance (B, 2, 2) of noise times signals (B, 2, N), noise spectra, and any colour (B,)."""
    N = error.shape[1]
    length, signals = next_fast_len(N, real=True), model.projected(filtered)
    transformed = np.fft.rfft(np.concatenate([error[:, None], signals], axis=1), length)
    E, X = transformed[:, 0], transformed[:, 1:]
    spectra, coloured = _spectrum(model, (E * E.conj()).real / N, length, crossover)
    X = X * np.sqrt(_sides(X.shape[2]) / length)
    return ((X * spectra[:, None]) @ X.conj().swapaxes(1, 2)).real, spectra, coloured


def _halves(model: BlackBox, error: Array, filters: Array) -> Array:
    """Difference (B, 2) of what both halves of a recording ask for.

    The residual that the whole leaves over is fitted in the first half; in the second it is the
    opposite, and either holds about half of the information.
    """
    half = error.shape[1] // 2
    first = np.empty((0, half))
    _, right = model.functions.normal_equations(
        model.u[:, :half], np.ascontiguousarray(error[:, :half]), model.Ts, first
    )
    return np.asarray(-4 * (filters @ right[..., None])[..., 0])


def _bend(model: BlackBox, output: Array, error: Array) -> tuple[Array, Array]:
    """What a cube of the output explains of residuals, as growth of the slope, and its doubt."""
    cube = model.projected((output**3)[:, None])[:, 0]
    _, right = model.functions.normal_equations(
        model.u, cube, model.Ts, np.empty((0, cube.shape[1]))
    )
    explained = (right * np.linalg.solve(model.information, right[..., None])[..., 0]).sum(axis=1)
    left = (cube**2).sum(axis=1) - explained
    slope = 3 * (output**2).mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = slope * (cube * error).sum(axis=1) / left
        doubt = slope * np.sqrt((error**2).mean(axis=1) * model.oversampled / left)
    flat = left <= _ROUNDING * (cube**2).sum(axis=1)  # two levels of the output: nothing tells
    return np.where(flat, 0.0, share), np.where(flat, 0.0, doubt)


def _weighted(
    model: BlackBox, i: int, spectrum: Array, at: Complex, target: Target
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
    length, n = next_fast_len(N, real=True), len(phi)
    sides = _sides(length // 2 + 1)
    X = _stacked(np.fft.rfft(signals, length) * np.sqrt(sides / length))
    spectrum = np.tile(spectrum, 2)
    for _ in range(_WEIGHINGS):
        gram = products(X / spectrum, X)
        inverse = np.linalg.pinv(gram[n:-1, n:-1], hermitian=True)
        rest = [*range(n), -1]
        Y = X[rest] - combined((inverse @ gram[n:-1][:, rest]).T, X[n:-1])
        reduced = lifted(products(Y / spectrum, Y))
        found = regularised(reduced[None, :-1, :-1], reduced[None, :-1, -1], reduced[-1:, -1],
                            np.ones(1))  # fmt: skip
        c = found.coefficients[0]
        error = Y[-1] - combined(c[None], Y[:-1])[0]
        taken = _leverage(found.estimator[0], Y[:-1]) + _leverage(inverse, X[n:-1])
        power = _folded(error**2) * length / N / sides
        left = np.maximum(1 - taken / spectrum[: len(sides)] / sides, 0.0)
        spectrum = np.tile(_banded(model, power, left, length, target.crossover), 2)
    near = np.arange(len(left)) / (length * model.Ts * target.crossover)
    here = (near > _NEAR[0]) & (near < _NEAR[1])
    freedom = max(2 * left[here].sum(), 1.0)
    level = spectrum[: len(sides)][here].mean()
    stronger = level > _STRONG * power.mean() * model.oversampled
    doubt = (1 + (_FEW / freedom) ** 2) ** 2 if stronger else 1.0
    J = _slopes(c[None], at)
    middle = found.estimator @ reduced[None, :-1, :-1] @ found.estimator + found.hidden
    return c, doubt * (J @ middle @ J.swapaxes(1, 2))[0]


def _stacked(X: Complex) -> Array:
    """Real parts, then imaginary parts, (m, 2F): inner products of these are those of signals."""
    return np.concatenate([X.real, X.imag], axis=1)


def _folded(values: Array) -> Array:
    """Sums (F,) over real and imaginary parts (2F,)."""
    return np.asarray(values.reshape(2, -1).sum(axis=0))


def _leverage(inverse: Array, X: Array) -> Array:
    """What a fit takes from each frequency (F,), by its inverse normal matrix."""
    return _folded((X * combined(inverse, X)).sum(axis=0))


def _banded(model: BlackBox, power: Array, left: Array, length: int, crossover: float) -> Array:
    """Noise spectrum (F,) of a residual's power, of which a fit has left a share (F,) over."""
    frequency = np.arange(len(power)) / (length * model.Ts * crossover)
    band = np.searchsorted(_BANDS, frequency)
    freedom = np.bincount(band, left, len(_BANDS) + 1)
    sums = np.bincount(band, power, len(_BANDS) + 1)
    return np.asarray(((sums + power.sum() / len(power)) / np.maximum(freedom - 1, 0.5))[band])


def _sides(count: int) -> Array:
    """How often each frequency of a real signal's transform stands for: twice but for the ends."""
    sides = np.full(count, 2.0)
    sides[0] = sides[-1] = 1.0
    return sides


def _spectrum(
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
    sums = np.stack([power[:, band == b].sum(axis=1) for b in range(len(count))], axis=1)
    left = len(frequency) - min(n / 2, len(frequency) / 2)
    overall = sums.sum(axis=1, keepdims=True) / left * model.oversampled
    with np.errstate(divide="ignore", invalid="ignore"):
        level = sums / (count * taken)
        coloured = level > overall * (1 + _COLOURED / np.sqrt(count))
    return np.where(coloured, level, overall)[:, band], coloured[:, :-1].any(axis=1)


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
