"""The response that a recording shows at the crossover, and the gains that it asks for.

The black box's coefficients are estimated again, drawn to a smooth response
(`tuners.trust.likely_prior`), with a covariance that holds for coloured noise
(`tuners.trust.noise_spectrum`).  The response at the crossover then has gains in closed form, by
the design rule.  Nothing of the simulator is used.
"""

from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre import Laguerre
from tuners.trust.black_box import BlackBox
from tuners.trust.curvature import Curvature
from tuners.trust.likely_prior import from_white, white_variance
from tuners.trust.memory import lingering
from tuners.trust.noise_spectrum import response_slopes, sandwich, weighted
from tuners.trust.pulses import pulses_of
from yawrate_env.batch import take
from yawrate_env.loop import controller
from yawrate_env.loop.design import Design, Status, design_from_response
from yawrate_env.loop.target import Target
from yawrate_env.loop.transfer_function import delta_operator
from yawrate_env.plant.responses import OpenLoop

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_LOWEST, _HIGHEST, _POINTS = 1 / 30, 3.5, 256  # of the crossover, and frequencies between
_NYQUIST = 0.95  # of half the controller's rate: the highest frequency that is looked at
_NOISE_LEFT = 0.02  # of the residual, where a difference between halves explains nearly all
_SURE = 3.0  # standard deviations


@dataclass(frozen=True, eq=False)
class Response:
    """What B recordings say of the plant around the crossover, as the controller sees it.

    Attributes
    ----------
    target : Target
        Of the loop.
    model : BlackBox
        The black box, not yet regularised.
    coefficients : NDArray
        (B, n) regularised, on its functions; ``nan`` for several recordings together.
    omega : NDArray
        (F,) frequencies [rad/s], evenly spaced in their logarithm.
    values : NDArray
        (B, F) complex128, the plant's response, the loop's delay in it.
    required : NDArray
        (B, 2) log magnitude and phase [rad] that the controller must supply.
    covariance : NDArray
        (B, 2, 2) of `required`.
    output : NDArray
        (B, N) the black box's, without offset and free response.
    noise : NDArray
        (B,) mean square of its residual.
    colour : NDArray
        (B,) power of the residual around the crossover over that of white noise.
    halves : NDArray
        (B, 2) by how much the second half of the recording asks for another `required`.
    changed : NDArray
        (B,) share of the residual that a difference between the halves explains.
    lingering : NDArray
        (B,) what is taken for the start's free response and lasts too long, over the output.
    curvature : Curvature
        Whether the response bends with the amplitude.
    """

    target: Target
    model: BlackBox
    coefficients: Array
    omega: Array
    values: Complex
    required: Array
    covariance: Array
    output: Array
    noise: Array
    colour: Array
    halves: Array
    changed: Array
    lingering: Array
    curvature: Curvature

    @classmethod
    def of(cls, model: BlackBox, target: Target) -> "Response":
        """Response of black boxes at the target's crossover, regularised."""
        found, omega = from_white(model), _frequencies(target)
        seen = _functions_seen(model.functions, model.Ts, target)
        at = seen[:, -1]
        J = response_slopes(found.coefficients, at)
        weights = np.concatenate([model.coefficients[:, None], J @ found.estimator], axis=1)
        signals = model.functions.outputs(model.u, weights, model.Ts)
        output, error = signals[:, 0], model.y - signals[:, 0]
        covariance, spectra, coloured = sandwich(model, error, signals[:, 1:], target.crossover)
        covariance += J @ found.hidden @ J.swapaxes(1, 2)
        halves, changed = _halves(model, error, J @ found.estimator)
        curvature = Curvature.of(model, output, error, J, target.crossover)
        smooth = found.coefficients.copy()
        for i in np.flatnonzero(coloured).tolist():
            found.coefficients[i], covariance[i] = weighted(
                model, i, spectra[i], at, target.crossover
            )
        values, here = np.split(np.einsum("bn,nf->bf", found.coefficients, seen), [-1], axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            phase = _phase_at(omega, values, here[:, 0], target.omega_c)
            log_magnitude = -np.log(np.abs(here[:, 0]))
        needed = np.radians(target.phase_margin) - np.pi - phase
        required = np.stack([log_magnitude, needed], axis=1)
        noise = (error**2).mean(axis=1)
        at_crossover = round(2 * (spectra.shape[1] - 1) * model.Ts * target.crossover)
        colour = spectra[:, at_crossover] / np.where(noise > 0, noise, 1.0) / model.oversampled
        return cls(
            target, model, found.coefficients, omega, values, required, covariance, output, noise,
            colour, halves, changed, lingering(model, smooth), curvature,
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.values)

    @cached_property
    def gains(self) -> Array:
        """(B, 2) gains of the design rule; ``nan`` where no controller comes near the target."""
        found = self._design
        return np.stack([found.kp, found.Ti], axis=1)

    @cached_property
    def _design(self) -> Design:
        log_magnitude, phase = self.required.T
        return design_from_response(log_magnitude, phase, self.target)

    @property
    def within_reach(self) -> NDArray[np.bool_]:
        """(B,) whether the controller reaches the target."""
        return np.asarray(self._design.status == Status.OK)

    @property
    def without_gains(self) -> NDArray[np.bool_]:
        """(B,) whether no controller comes near the target, beyond what noise can do."""
        with np.errstate(invalid="ignore"):
            doubt = _SURE * np.sqrt(self.covariance[:, 1, 1])
            return np.asarray(self.required[:, 1] + doubt <= -np.pi / 2)

    @property
    def aim(self) -> Array:
        """(2,) phase margin [deg] and crossover [Hz] of the target."""
        return np.array([self.target.phase_margin, self.target.crossover])

    @cached_property
    def reached(self) -> Array:
        """(B, 2) metrics of `gains`; the target where there are none."""
        metrics = self.metrics(self.gains)
        return np.where(np.isfinite(metrics).all(axis=1, keepdims=True), metrics, self.aim)

    def open_loop(self, gains: Array, i: int) -> OpenLoop:
        """The loop of gains (2,) around one recording's response, as reports draw it."""
        return OpenLoop(
            self.omega / (2 * np.pi),
            self._loop(self.values[[i]], gains[None])[0],
            pulse=self._pulse(i),
        )

    def _pulse(self, i: int) -> Array | None:
        """Output (K,) at the controller's samples for an input of one during the first of them.

        None where the recording's samples are no whole parts of the controller's, or where there
        are several recordings.
        """
        pulses = pulses_of(self.model.functions, self.model.Ts, self.target)
        if pulses is None or not np.isfinite(self.coefficients[i]).all():
            return None
        return np.ascontiguousarray(self.coefficients[i] @ pulses)

    def doubt(self, gains: Array, half: Array) -> Array | None:
        """What one recording leaves open of the plant's pulse response, (n, K).

        A band's half width, of whatever is linear in the pulse response, is the root of the sum
        of the squares that these give.  They are a root of the covariance that white noise gives
        the coefficients, scaled so that the metrics of gains (2,) have half widths of at least
        `half` (2,).  None where pulse or scale is unknown.
        """
        pulses = pulses_of(self.model.functions, self.model.Ts, self.target)
        if pulses is None or len(self) != 1 or not np.isfinite(self.coefficients).all():
            return None
        found, gram = from_white(self.model), self.model.information[0]
        E = found.estimator[0]
        P = white_variance(self.model)[0] * E @ gram @ E + found.hidden[0]
        at = _functions_seen(self.model.functions, self.model.Ts, self.target)[:, -1]
        J = (self._metric_slopes(gains[None]) @ response_slopes(found.coefficients, at))[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = (half / np.sqrt(np.einsum("ij,jk,ik->i", J, P, J))).max()
        if not np.isfinite(factor):
            return None
        values, vectors = np.linalg.eigh(P)
        return np.asarray(factor * (vectors * np.sqrt(np.maximum(values, 0))).T @ pulses)

    def part(self, i: int) -> "Response":
        """Recording `i` alone."""
        apart = {"target", "model", "omega", "curvature"}
        rows = {f.name: getattr(self, f.name)[[i]] for f in fields(self) if f.name not in apart}
        curvature = take(self.curvature, np.array([i]))
        return replace(self, model=self.model.part(i), curvature=curvature, **rows)

    def at(self, crossover: float) -> "Response":
        """The same recordings' response, for a target with another crossover [Hz]."""
        return Response.of(self.model, replace(self.target, crossover=crossover))

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
            covariance *= np.maximum(1 - self.changed, _NOISE_LEFT)[:, None, None]
            regular = np.asarray(np.isfinite(covariance).all(axis=(1, 2)))[:, None, None]
            covariance = np.where(regular, covariance, np.eye(2))
            scaled = np.linalg.solve(covariance, difference[..., None])[..., 0]
            return np.abs(difference) / 2, np.sqrt((difference * scaled).sum(axis=1))

    def bent(self, gains: Array, sure: float) -> Array:
        """Metrics (B, 2) by which gains differ between no amplitude and the recording's.

        The most of the terms that are `sure` standard deviations from none.
        """
        J, terms = self._metric_slopes(gains), self.curvature
        with np.errstate(invalid="ignore"):
            shifts = np.abs(np.einsum("bij,bmj->bmi", J, terms.shifts))
        return np.asarray(np.where(terms.sizes[..., None] > sure, shifts, 0.0).max(axis=1))

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

    def _loop(self, values: Complex, gains: Array) -> Complex:
        """Open loops (B, F) of responses (B, F) and gains (B, 2)."""
        kp, Ti = gains.T
        n1, n0, d0 = (c[:, None] for c in controller.coefficients(kp, Ti, self.target))
        delta = delta_operator(self.omega, self.target.Ts)
        return np.asarray(values * (n1 * delta + n0) / (delta + d0))

    def _crossing(self, gains: Array) -> tuple[Array, tuple[Array, Array]]:
        """Metrics, and the slopes of log magnitude and phase over log frequency, (B,) each."""
        log_omega = np.log(self.omega)
        with np.errstate(divide="ignore", invalid="ignore"):
            L = self._loop(self.values, gains)
            magnitude, phase = np.log(np.abs(L)), np.unwrap(np.angle(L), axis=1)
            falls: NDArray[np.bool_] = np.logical_and(magnitude[:, :-1] > 0, magnitude[:, 1:] <= 0)
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


def _halves(model: BlackBox, error: Array, filters: Array) -> tuple[Array, Array]:
    """Difference (B, 2) of what a recording's halves ask for, and its share (B,) of the error.

    The residual that the whole leaves over is fitted in the first half; in the second it is the
    opposite, and either holds about half of the information.
    """
    half = error.shape[1] // 2
    nothing, first = np.empty((0, half)), np.ascontiguousarray(error[:, :half])
    _, right = model.functions.normal_equations(model.u[:, :half], first, model.Ts, nothing)
    explained = 4 * (right * np.linalg.solve(model.information, right[..., None])[..., 0])
    energy = (error**2).sum(axis=1)
    share = explained.sum(axis=1) / np.where(energy > 0, energy, 1.0)
    return np.asarray(-4 * (filters @ right[..., None])[..., 0]), share


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
