"""Fit of one plant to several recordings: parameters in common, measured ones of each its own.

For independent noise the sums of squared output errors, each over its recording's noise, add up,
and so does the Fisher information (Ljung, *System Identification*, 2nd ed., section 7.4):

    F = sum_i S_i S_i^T / sigma_i^2 + 12 I,

with S_i the slopes of recording i in widths of the parameters' ranges, and the prior's precision
once.  Levenberg-Marquardt steps find the least sum.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tuners.trust.black_box import BlackBox
from tuners.trust.discrepancy import Discrepancy
from tuners.trust.fit import Fit, noise_level, signals
from tuners.trust.identification import LARGEST_STEP, UNIFORM, drawn_to_prior, moved
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Signals = tuple[Array, Array]

_STEPS = 25
_UNSEEN = 1e-3  # of the noise's variance: a step that changes the outputs by less is none
_SETTLED = 1e-5  # of a range: the last step is no longer
_STIFFEST = 1e8  # damping beyond which no step helps
_ROOM = 1e-9  # of a range: nearer to a limit is on it


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """One plant for each of B sets of L recordings.

    Attributes
    ----------
    fits : tuple of Fit
        One for each recording: its own residual and noise, parameters in common but for the
        measured ones, and the covariance that all recordings together leave.
    information : NDArray
        (L, B, q, q) of the unknown parameters, in widths of their ranges.
    discrepancy : Discrepancy, optional
        Of all recordings in a row, where no response judges.
    """

    fits: tuple[Fit, ...]
    information: Array
    discrepancy: Discrepancy | None

    @property
    def shares(self) -> Array:
        """(L, B) shares of the information, which add up to 1."""
        covariance = np.nan_to_num(self.fits[0].covariance, posinf=0.0)
        found = np.einsum("bij,lbji->lb", covariance, self.information)
        return shares(found)

    def at(self, plant: Plant, theta: Array) -> Fit:
        """The plants with the measured parameters of `theta` (B, p), and all signals in a row."""
        shared = theta.copy()
        shared[:, plant.unknown] = self.fits[0].theta[:, plant.unknown]
        simulated, residual = (
            plant.in_a_row([getattr(each, name) for each in self.fits])
            for name in ("simulated", "residual")
        )
        noise = np.max([each.noise for each in self.fits], axis=0)
        return replace(
            self.fits[0], theta=shared, simulated=simulated, residual=residual, noise=noise,
            discrepancy=self.discrepancy,
        )  # fmt: skip


def shares(parts: Array) -> Array:
    """Parts (L, B) over their sums; equal ones where there is nothing."""
    total = parts.sum(axis=0)
    equal = np.full_like(parts, 1 / max(len(parts), 1))
    return np.asarray(np.divide(parts, total, out=equal, where=total > 0))


def joint_fit(
    plant: Plant, models: Sequence[BlackBox], alone: Sequence[Fit], measured: Sequence[Array]
) -> Joint:
    """Fit one plant to the L recordings of each of B sets.

    Parameters
    ----------
    models, alone : L of BlackBox and Fit
        Of each recording: its fit is a start of the search, and its noise the weight.
    measured : L of (B, N) or (B, q, N) float64
        Outputs as recorded.
    """
    problem = _Problem(plant, models, [each.theta for each in alone], alone)
    theta = _start(problem)
    now, damping = problem.signals(theta), np.full(len(theta), 1e-6)
    settled = np.zeros(len(theta), dtype=np.bool_)
    low, high = plant.limits
    for _ in range(_STEPS):
        step = _damped(*now, damping)
        trial = moved(plant, theta, np.clip(step, -LARGEST_STEP, LARGEST_STEP), low, high)
        taken = (trial - theta)[:, plant.unknown] / plant.width
        gained = ((taken[:, None] @ now[1])[:, 0] ** 2).sum(axis=1)
        small = (np.abs(taken).max(axis=1, initial=0.0) <= _SETTLED) | (gained <= _UNSEEN)
        found = problem.signals(trial)
        better = ~settled & (_cost(found[0]) <= _cost(now[0]))
        theta = np.where(better[:, None], trial, theta)
        now = (
            np.where(better[:, None], found[0], now[0]),
            np.where(better[:, None, None], found[1], now[1]),
        )
        damping = damping * np.where(better, 0.1, 100.0)
        settled |= small
        if (settled | (damping > _STIFFEST)).all():
            break
    return _finished(problem, measured, theta, settled & ~_at_limit(plant, theta))


def fitted_like(plant: Plant, joint: Joint, model: BlackBox, alone: Fit, measured: Array) -> Fit:
    """A further recording with the plants found, and its own measured parameters."""
    theta = alone.theta.copy()
    theta[:, plant.unknown] = joint.fits[0].theta[:, plant.unknown]
    error, _ = signals(plant, theta, model)
    noise = noise_level(error, model.Ts, plant.crossover)
    return replace(
        joint.fits[0], theta=theta, simulated=plant.stacked(measured) - error, residual=error,
        noise=noise,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Problem:
    """Recordings, their own measured parameters, and their own fits."""

    plant: Plant
    models: Sequence[BlackBox]
    thetas: Sequence[Array]
    alone: Sequence[Fit]

    def of(self, theta: Array, i: int) -> Array:
        """Parameters (B, p) with those measured in recording `i`."""
        own = self.thetas[i].copy()
        own[:, self.plant.unknown] = theta[:, self.plant.unknown]
        return own

    def signals(self, theta: Array) -> Signals:
        """Output errors (B, N) and slopes (B, q, N) of all recordings, over their noise."""
        parts = []
        for i, (model, alone) in enumerate(zip(self.models, self.alone, strict=True)):
            error, slopes = signals(self.plant, self.of(theta, i), model)
            scale = 1 / np.sqrt(_positive(alone.noise))
            parts.append((error * scale[:, None], slopes * scale[:, None, None]))
        errors, slopes_of_all = zip(*parts, strict=True)
        return np.concatenate(errors, axis=1), np.concatenate(slopes_of_all, axis=2)


def _start(problem: _Problem) -> Array:
    """The best of the weighted mean of the recordings' own fits, and of each of these."""
    plant, alone = problem.plant, problem.alone
    low, high = plant.limits
    weights = [_inverse(each.covariance) for each in alone]
    scaled = [each.theta[:, plant.unknown] / plant.width for each in alone]
    right = sum((w @ z[..., None])[..., 0] for w, z in zip(weights, scaled, strict=True))
    mean = (_inverse(sum(weights, np.zeros(()))) @ np.asarray(right)[..., None])[..., 0]
    middle = alone[0].theta.copy()
    middle[:, plant.unknown] = np.clip(mean * plant.width, low[plant.unknown], high[plant.unknown])
    best, least = middle, _cost(problem.signals(middle)[0])
    if len(alone) > 1:
        for each in alone:
            cost = _cost(problem.signals(each.theta)[0])
            better = cost < least
            best, least = np.where(better[:, None], each.theta, best), np.minimum(cost, least)
    return np.asarray(best)


def _finished(problem: _Problem, measured: Sequence[Array], theta: Array, done: Flags) -> Joint:
    """What the search found, with the noise that it leaves."""
    plant, found, scaled = problem.plant, [], []
    for i, model in enumerate(problem.models):
        own = problem.of(theta, i)
        error, slopes = signals(plant, own, model)
        noise = noise_level(error, model.Ts, plant.crossover)
        if plant.crossover is None:
            noise = noise * model.oversampled
        scale = 1 / np.sqrt(_positive(noise))
        scaled.append((error * scale[:, None], slopes * scale[:, None, None]))
        found.append((own, plant.stacked(measured[i]) - error, error, noise))
    errors, slopes = (plant.in_a_row(parts) for parts in zip(*scaled, strict=True))
    ones = np.ones(len(theta))
    inverse, covariance = drawn_to_prior(slopes, ones)
    discrepancy = None
    if plant.loop_target is None:
        simulated = plant.in_a_row([each[1] for each in found])
        oversampled = max(model.oversampled for model in problem.models)
        discrepancy = Discrepancy.of(
            errors, slopes, simulated, ones, inverse, covariance, oversampled,
            len(plant.outputs_named),
        )  # fmt: skip
    fits = tuple(
        Fit(own, done, simulated, error, noise, covariance, None)
        for own, simulated, error, noise in found
    )
    information = np.stack([np.nan_to_num(S @ S.swapaxes(1, 2)) for _, S in scaled])
    return Joint(fits, information, discrepancy)


def _damped(error: Array, slopes: Array, damping: Array) -> Array:
    """Steps (B, q) of whitened signals; the prior's precision keeps them finite."""
    gram = slopes @ slopes.swapaxes(1, 2)
    regular = np.asarray(np.isfinite(gram).all(axis=(1, 2)))
    regular &= np.isfinite(error).all(axis=1)
    gram = np.where(regular[:, None, None], gram, 0.0)
    eye = np.eye(gram.shape[1])
    lifted = gram + eye / UNIFORM + damping[:, None, None] * gram * eye
    right = np.where(regular[:, None], np.nan_to_num((slopes @ error[..., None])[..., 0]), 0.0)
    return np.asarray(np.linalg.solve(lifted, right[..., None])[..., 0])


def _cost(error: Array) -> Array:
    cost = (error**2).sum(axis=1)
    return np.where(np.isfinite(cost), cost, np.inf)


def _inverse(matrix: Array) -> Array:
    """Inverse of symmetric matrices (B, q, q), zero where they are not finite."""
    regular = np.asarray(np.isfinite(matrix).all(axis=(1, 2)))[:, None, None]
    return np.where(regular, np.linalg.pinv(np.where(regular, matrix, 0.0), hermitian=True), 0.0)


def _positive(noise: Array) -> Array:
    """Mean squares (B,); without noise all recordings count alike."""
    return np.where(noise > 0, noise, 1e-300)


def _at_limit(plant: Plant, theta: Array) -> Flags:
    """Whether a limit outside the prior stopped the search, (B,)."""
    free, ((low, high), (least, most)) = plant.unknown, (plant.ranges, plant.limits)
    at, room = theta[:, free], _ROOM * plant.width
    on = (at - least[free] <= room) | (most[free] - at <= room)
    outside = (at < low[free] - room) | (at > high[free] + room)
    return np.asarray((on & outside).any(axis=1))
