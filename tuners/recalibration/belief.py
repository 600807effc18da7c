"""What is known of parameters that walk and jump, for B cars: a Kalman filter with two hypotheses.

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

from yawrate_env.compiled import kernel

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
    return weighed(belief, motion, F, i)[0]


def weighed(belief: Belief, motion: Motion, F: Array, i: Array) -> tuple[Belief, Array]:
    """`follow`, and the logarithm (B,) of the evidence but for what all beliefs share."""
    walked = motion.walked(belief)
    stay, log_stay = _updated(walked, F, i)
    moved, log_moved = _updated(motion.forgotten(walked), F, i)
    log_moved += np.log(motion.jump)
    log_stay += np.log1p(-motion.jump)
    share = 1 / (1 + np.exp(-np.clip(log_moved - log_stay, -700.0, 700.0)))
    return _merged(stay, moved, share), np.logaddexp(log_stay, log_moved)


def _updated(belief: Belief, F: Array, i: Array) -> tuple[Belief, Array]:
    """Posterior, and the logarithm (B,) of the evidence but for what all hypotheses share."""
    mean, after = np.empty_like(belief.mean), np.empty_like(belief.covariance)
    evidence = np.empty(len(belief))
    _update(belief.mean, belief.covariance, F, i, mean, after, evidence)
    return Belief(mean, after, belief.jumped), evidence


@kernel
def _update(
    m: NDArray[np.float64],
    P: NDArray[np.float64],
    F: NDArray[np.float64],
    i: NDArray[np.float64],
    mean: NDArray[np.float64],
    after: NDArray[np.float64],
    evidence: NDArray[np.float64],
) -> None:
    """``P+ = (1 + P F)^-1 P`` by elimination with pivots, whose product is the determinant."""
    q = m.shape[1]
    W, X, pull = np.empty((q, q)), np.empty((q, q)), np.empty(q)
    for b in range(len(m)):
        J = 0.0
        for r in range(q):
            Fm = 0.0
            for c in range(q):
                Fm += F[b, r, c] * m[b, c]
                W[r, c], X[r, c] = 1.0 if r == c else 0.0, P[b, r, c]
                for k in range(q):
                    W[r, c] += P[b, r, k] * F[b, k, c]
            pull[r] = i[b, r] - Fm
            J += m[b, r] * (Fm - 2 * i[b, r])
        logarithm = 0.0
        for k in range(q):
            best = k
            for r in range(k + 1, q):
                if abs(W[r, k]) > abs(W[best, k]):
                    best = r
            if best != k:
                for c in range(q):
                    W[k, c], W[best, c] = W[best, c], W[k, c]
                    X[k, c], X[best, c] = X[best, c], X[k, c]
            logarithm += np.log(abs(W[k, k]))
            for r in range(k + 1, q):
                factor = W[r, k] / W[k, k]
                for c in range(k + 1, q):
                    W[r, c] -= factor * W[k, c]
                for c in range(q):
                    X[r, c] -= factor * X[k, c]
        for k in range(q - 1, -1, -1):
            for c in range(q):
                for r in range(k + 1, q):
                    X[k, c] -= W[k, r] * X[r, c]
                X[k, c] /= W[k, k]
        for r in range(q):
            step = 0.0
            for c in range(q):
                step += 0.5 * (X[r, c] + X[c, r]) * pull[c]
                after[b, r, c] = 0.5 * (X[r, c] + X[c, r])
            mean[b, r] = m[b, r] + step
            J -= pull[r] * step
        evidence[b] = -0.5 * (J + logarithm)


def _merged(a: Belief, b: Belief, share: Array) -> Belief:
    """One normal distribution for mixtures with shares (B,) of the second."""
    w = share[:, None]
    apart = b.mean - a.mean
    between = (w * (1 - w))[..., None] * apart[:, :, None] * apart[:, None]
    covariance = (1 - w[..., None]) * a.covariance + w[..., None] * b.covariance + between
    return Belief((1 - w) * a.mean + w * b.mean, covariance, share)
