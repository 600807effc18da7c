"""Agreement of recordings: a chi-square test of each against the others together.

Recording i has an estimate x_i with information G_i, and b_i = G_i x_i.  The sum of squares that
the others' common estimate costs recording i,

    T_i = b_i' G_i^-1 b_i + b_o' G_o^-1 b_o - (b_i + b_o)' (G_i + G_o)^-1 (b_i + b_o),

with o the sum over the others, is chi-square distributed for one plant (the likelihood-ratio test
of common regression coefficients; Chow, 1960).  Where a black box can follow the plant, x are its
coefficients on what the fitted plant leaves over, so that errors of the plant's data that all
recordings share do not count; elsewhere x are the plant's unknown parameters.

The recording that differs most is set apart before the rest is tested.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.trust.black_box import BlackBox
from tuners.trust.fit import Fit
from tuners.trust.response import Response

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

CHANCE = 0.01
"""Of sets of right recordings, how many are said to hold another plant."""

_COLOURED = 1.7  # noise stronger by this around the crossover: more than chance for white noise
_RANK = 1e-10  # of the largest information: directions with less tell nothing


@dataclass(frozen=True, slots=True, eq=False)
class Estimates:
    """Estimates of L recordings of each of B sets, as information and its product with them.

    Attributes
    ----------
    information : NDArray
        (L, B, n, n).
    right : NDArray
        (L, B, n).
    """

    information: Array
    right: Array

    @classmethod
    def of_responses(
        cls, models: list[BlackBox], fits: list[Fit], responses: list[Response]
    ) -> "Estimates":
        """Black boxes' coefficients on what fitted plants leave over."""
        parts = []
        for model, fit, response in zip(models, fits, responses, strict=True):
            N, free = fit.residual.shape[1], model.functions.order + model.extra
            independent = np.maximum(N / model.oversampled - free, 1.0)
            noise = response.noise * (1 + free / independent)  # of so many unknowns it lost
            noise = noise * np.where(response.colour > _COLOURED, response.colour, 1.0)
            weight = 1 / np.where(noise > 0, noise * model.oversampled, np.inf)
            nothing = np.empty((0, model.u.shape[1]))
            right = model.functions.normal_equations(model.u, fit.residual, model.Ts, nothing)[1]
            parts.append((model.information * weight[:, None, None], right * weight[:, None]))
        return cls(*(np.stack(part) for part in zip(*parts, strict=True)))

    @classmethod
    def of_fits(cls, fits: list[Fit], unknown: NDArray[np.intp], width: Array) -> "Estimates":
        """Parameters of the recordings' own fits, in widths of their ranges."""
        covariance = [f.covariance if f.discrepancy is None else f.discrepancy.covariance
                      for f in fits]  # fmt: skip
        information = np.stack([_inverse(each) for each in covariance])
        values = np.stack([fit.theta[:, unknown] / width for fit in fits])
        return cls(information, (information @ values[..., None])[..., 0])

    @property
    def freedom(self) -> int:
        """Degrees of freedom of one test."""
        return int(self.right.shape[-1])

    def distances(self, among: Flags) -> Array:
        """T_i (L, B) of each recording against those `among` (L, B), itself left out."""
        information, right = self.information, self.right
        explained = _explained(information, right)
        kept = np.where(among[..., None], right, 0.0)
        held = np.where(among[..., None, None], information, 0.0)
        others = held.sum(axis=0) - held, kept.sum(axis=0) - kept
        together = others[0] + information, others[1] + right
        found = explained + _explained(*others) - _explained(*together)
        return np.where(others[1].any(axis=-1), np.maximum(found, 0.0), 0.0)


def against_others(
    found: Estimates, without: Callable[[Flags], Estimates] | None = None
) -> tuple[Array, Array, Flags]:
    """Chi-squares (L, B), their probabilities under one plant, and which recordings differ.

    Of two recordings that differ both do: nothing tells which is right.

    Parameters
    ----------
    without : callable, optional
        ``without(apart)``: the same with a plant fitted to all recordings but those apart (L, B),
        which may have drawn the first one away from the others.
    """
    from scipy.stats import chi2

    L, B = found.right.shape[:2]
    apart = np.zeros((L, B), dtype=np.bool_)
    for _ in range(L - 2):
        distances = np.where(apart, -np.inf, found.distances(~apart))
        worst = distances.argmax(axis=0)
        beyond = chi2.sf(distances.max(axis=0), found.freedom) < CHANCE / L
        if not beyond.any():
            break
        apart[worst[beyond], np.flatnonzero(beyond)] = True
        found = found if without is None else without(apart)
    distances = found.distances(~apart)
    chance = chi2.sf(distances, found.freedom)
    return distances, chance, apart | (chance < CHANCE / L)


def _explained(information: Array, right: Array) -> Array:
    """Sums of squares b' G^-1 b, without directions of which nothing is known."""
    values, vectors = np.linalg.eigh(information)
    shown = values > _RANK * values.max(axis=-1, keepdims=True, initial=0.0)
    turned = (right[..., None, :] @ vectors)[..., 0, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(shown, turned**2 / values, 0.0).sum(axis=-1))


def _inverse(covariance: Array) -> Array:
    regular = np.asarray(np.isfinite(covariance).all(axis=(1, 2)))[:, None, None]
    safe = np.where(regular, covariance, 0.0)
    return np.where(regular, np.linalg.pinv(safe, hermitian=True), 0.0)
