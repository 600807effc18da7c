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

from yawrate_env.compiled import kernel, subkernel
from yawrate_env.vehicle.kalman import solve

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


def follow(belief: Belief, motion: Motion, F: Array, i: Array) -> Belief:
    """The belief after one more window with information F (B, q, q), and i = F z (B, q)."""
    return weighed(belief, motion, F, i)[0]


def weighed(
    belief: Belief, motion: Motion, F: Array, i: Array, live: NDArray[np.int64] | None = None
) -> tuple[Belief, Array]:
    """`follow`, and the logarithm (B,) of the evidence but for what all beliefs share.

    Parameters
    ----------
    live : (B,) int64, optional
        How many of the coordinates there are, where it is not all; the others stay.
    """
    count, q = belief.mean.shape
    jump = np.broadcast_to(np.asarray(motion.jump, dtype=np.float64), (count,))
    live = np.full(count, q) if live is None else live
    mean, covariance = belief.mean.copy(), belief.covariance.copy()
    share, evidence = np.empty(count), np.empty(count)
    _follow(
        *(belief.mean, belief.covariance, motion.walk, F, i, live, np.log(jump), np.log1p(-jump)),
        *(motion.coordinate, motion.mean, motion.variance, mean, covariance, share, evidence),
    )
    return Belief(mean, covariance, share), evidence


@kernel
def _follow(
    m: NDArray[np.float64],
    P: NDArray[np.float64],
    walk: NDArray[np.float64],
    F: NDArray[np.float64],
    i: NDArray[np.float64],
    live: NDArray[np.int64],
    log_jump: NDArray[np.float64],
    log_stay: NDArray[np.float64],
    coordinate: int,
    anywhere: float,
    width: float,
    mean: NDArray[np.float64],
    covariance: NDArray[np.float64],
    share: NDArray[np.float64],
    evidence: NDArray[np.float64],
) -> None:
    """Both hypotheses and their mixture, row by row."""
    most = m.shape[1]
    W, stay, moved = np.empty((most, most)), np.empty((most, most)), np.empty((most, most))
    before, pull = np.empty((most, most)), np.empty(most)
    here, there, start = np.empty(most), np.empty(most), np.empty(most)
    for b in range(len(m)):
        q = live[b]
        for r in range(q):
            start[r] = m[b, r]
            for c in range(q):
                before[r, c] = P[b, r, c]
            before[r, r] += walk[b, r]
        staying = log_stay[b] + _updated(start, before, F[b], i[b], q, W, pull, here, stay)
        start[coordinate] = anywhere
        for r in range(q):
            before[r, coordinate], before[coordinate, r] = 0.0, 0.0
        before[coordinate, coordinate] = width
        moving = log_jump[b] + _updated(start, before, F[b], i[b], q, W, pull, there, moved)
        w = 1 / (1 + np.exp(min(max(staying - moving, -700.0), 700.0)))
        share[b] = w
        high, low = max(staying, moving), min(staying, moving)
        evidence[b] = high + np.log1p(np.exp(low - high))
        for r in range(q):
            mean[b, r] = (1 - w) * here[r] + w * there[r]
            for c in range(q):
                apart = (there[r] - here[r]) * (there[c] - here[c])
                covariance[b, r, c] = (1 - w) * (stay[r, c] + w * apart) + w * moved[r, c]


@subkernel
def _updated(
    m: NDArray[np.float64],
    P: NDArray[np.float64],
    F: NDArray[np.float64],
    i: NDArray[np.float64],
    q: int,
    W: NDArray[np.float64],
    pull: NDArray[np.float64],
    mean: NDArray[np.float64],
    X: NDArray[np.float64],
) -> float:
    """Mean and covariance X after a window, and the logarithm of the evidence.

    ``P+ = (1 + P F)^-1 P`` by elimination with pivots, whose product is the determinant.
    """
    J = 0.0
    for r in range(q):
        for c in range(q):
            W[r, c], X[r, c] = 0.0, P[r, c]
        W[r, r] = 1.0
        for k in range(q):
            for c in range(q):
                W[r, c] += P[r, k] * F[k, c]
        Fm = 0.0
        for c in range(q):
            Fm += F[r, c] * m[c]
        pull[r] = i[r] - Fm
        J += m[r] * (Fm - 2 * i[r])
    logarithm = solve(W[:q, :q], X[:q, :q])
    for r in range(q):
        for c in range(r):
            X[r, c] = X[c, r] = 0.5 * (X[r, c] + X[c, r])
    for r in range(q):
        step = 0.0
        for c in range(q):
            step += X[r, c] * pull[c]
        mean[r] = m[r] + step
        J -= pull[r] * step
    return -0.5 * (J + logarithm)
