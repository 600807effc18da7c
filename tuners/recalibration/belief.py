"""Belief about parameters that walk and jump, for B cars: a Kalman filter with two hypotheses.

Coordinates z (B, q) walk between windows; with a small probability one of them jumps instead, to
anywhere in its prior.  A window tells its information F and ``i = F z``.  With either hypothesis,
a normal distribution of mean m and covariance P, it makes

    P+ = (P^-1 + F)^-1,   m+ = m + P+ (i - F m),
    log p = -J/2 - log det(1 + P F)/2,   J = m' F m - 2 m' i - (i - F m)' P+ (i - F m)

where p is the evidence.  The two are merged into one normal distribution after every window (the
generalised pseudo-Bayesian filter of first order: Bar-Shalom, Li and Kirubarajan, 2001, sec. 11.6),
so that the belief is wide as long as windows do not tell them apart.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """Normal distributions of coordinates.

    Attributes
    ----------
    mean, covariance : NDArray
        (B, q) and (B, q, q).
    jumped : NDArray
        (B,) probability that a coordinate jumped before the last window.
    """

    mean: Array
    covariance: Array
    jumped: Array

    def __len__(self) -> int:
        return len(self.mean)


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """How coordinates move between windows.

    Attributes
    ----------
    walk : NDArray
        (B, q) variances that the walk adds.
    jump : float or NDArray
        Probability of a jump instead, or (B,) of them.
    coordinate : int
        Which one jumps.
    mean, variance : float
        Where it jumps to.
    """

    walk: Array
    jump: float | Array
    coordinate: int
    mean: float
    variance: float

    def walked(self, belief: Belief) -> Belief:
        """Before the next window, if nothing jumps."""
        added = self.walk[:, None] * np.eye(self.walk.shape[1])
        return Belief(belief.mean, belief.covariance + added, np.zeros(len(belief)))

    def forgotten(self, belief: Belief) -> Belief:
        """If the coordinate jumps: only of the others something is left known."""
        i, mean, covariance = self.coordinate, belief.mean.copy(), belief.covariance.copy()
        mean[:, i] = self.mean
        covariance[:, i], covariance[:, :, i] = 0.0, 0.0
        covariance[:, i, i] = self.variance
        return Belief(mean, covariance, np.ones(len(belief)))


def follow(belief: Belief, motion: Motion, F: Array, i: Array) -> Belief:
    """The belief after one more window with information F (B, q, q), and i = F z (B, q)."""
    walked = motion.walked(belief)
    stay, log_stay = _updated(walked, F, i)
    moved, log_moved = _updated(motion.forgotten(walked), F, i)
    odds = np.log(motion.jump) - np.log1p(-motion.jump) + log_moved - log_stay
    share = 1 / (1 + np.exp(-np.clip(odds, -700.0, 700.0)))
    return _merged(stay, moved, share)


def _updated(belief: Belief, F: Array, i: Array) -> tuple[Belief, Array]:
    """Posterior, and the logarithm (B,) of the evidence but for what all hypotheses share."""
    m, P = belief.mean, belief.covariance
    after = np.asarray(np.linalg.inv(np.linalg.inv(P) + F), dtype=np.float64)
    Fm = (F * m[:, None]).sum(axis=2)
    pull = i - Fm
    step = (after * pull[:, None]).sum(axis=2)
    J = (m * (Fm - 2 * i)).sum(axis=1) - (pull * step).sum(axis=1)
    _, log_determinant = np.linalg.slogdet(np.eye(F.shape[1]) + P @ F)
    return Belief(m + step, after, belief.jumped), -(J + log_determinant) / 2


def _merged(a: Belief, b: Belief, share: Array) -> Belief:
    """One normal distribution for mixtures with shares (B,) of the second."""
    w = share[:, None]
    apart = b.mean - a.mean
    between = (w * (1 - w))[..., None] * apart[:, :, None] * apart[:, None]
    covariance = (1 - w[..., None]) * a.covariance + w[..., None] * b.covariance + between
    return Belief((1 - w) * a.mean + w * b.mean, covariance, share)
