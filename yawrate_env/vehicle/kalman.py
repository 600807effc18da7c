"""Stationary Kalman predictors, batched, by structured doubling (Chu, Fan and Lin, 2005)."""

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import kernel, over_blocks

Array = NDArray[np.float64]

_DOUBLINGS = 30
_CONVERGED = 1e-5  # relative, of the last but one doubling: its square is left
_BLOCK = 32


def kalman(A: Array, C: Array, Q: Array, white: float) -> tuple[Array, Array, Array]:
    """Stationary predictor gains (B, n), variances (B,) of errors, covariances (B, n, n) of states.

    Noise of covariance Q (B, n, n) enters the states, of variance `white` the output.  The Riccati
    equation is solved by structured doubling (Chu, Fan and Lin, 2005), which converges as Newton's
    rule does.
    """
    K, variance, P = np.empty(A.shape[:2]), np.empty(len(A)), np.empty(A.shape)

    def some(i: int, j: int) -> None:
        _kalman(A[i:j], C, Q[i:j], white, K[i:j], variance[i:j], P[i:j])

    over_blocks(some, len(A), _BLOCK)
    return K, variance, P


@kernel
def times(P: NDArray[np.float64], Q: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """The product of two matrices."""
    n = len(P)
    for i in range(n):
        for j in range(n):
            out[i, j] = 0.0
        for k in range(n):
            for j in range(n):
                out[i, j] += P[i, k] * Q[k, j]


@kernel
def solve(W: NDArray[np.float64], X: NDArray[np.float64]) -> float:
    """X becomes ``W^-1 X`` by elimination with pivots; W is destroyed.

    Returns the logarithm of the determinant's absolute value.
    """
    n, m = W.shape[0], X.shape[1]
    logarithm = 0.0
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(W[i, k]) > abs(W[best, k]):
                best = i
        if best != k:
            for j in range(n):
                W[k, j], W[best, j] = W[best, j], W[k, j]
            for j in range(m):
                X[k, j], X[best, j] = X[best, j], X[k, j]
        logarithm += np.log(abs(W[k, k]))
        for i in range(k + 1, n):
            factor = W[i, k] / W[k, k]
            for j in range(k + 1, n):
                W[i, j] -= factor * W[k, j]
            for j in range(m):
                X[i, j] -= factor * X[k, j]
    for k in range(n - 1, -1, -1):
        for j in range(m):
            for i in range(k + 1, n):
                X[k, j] -= W[k, i] * X[i, j]
            X[k, j] /= W[k, k]
    return logarithm


@kernel
def _kalman(
    A: NDArray[np.float64],
    C: NDArray[np.float64],
    Q: NDArray[np.float64],
    white: float,
    K: NDArray[np.float64],
    variance: NDArray[np.float64],
    covariance: NDArray[np.float64],
) -> None:
    """Doubling of F = A', G = C'C/white and H: H tends to the covariance of the state."""
    n = A.shape[1]
    F, G, H = np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    W, both, part, other = (
        np.empty((n, n)),
        np.empty((n, 2 * n)),
        np.empty((n, n)),
        np.empty((n, n)),
    )
    left, right = np.empty((n, n)), np.empty((n, n))
    for b in range(len(A)):
        for i in range(n):
            for j in range(n):
                F[i, j] = A[b, j, i]
                G[i, j] = C[i] * C[j] / white
                H[i, j] = Q[b, i, j]
        for _ in range(_DOUBLINGS):
            times(G, H, W)
            for i in range(n):
                W[i, i] += 1.0
                for j in range(n):
                    both[i, j], both[i, n + j] = F[i, j], G[i, j]
            solve(W, both)
            for i in range(n):
                for j in range(n):
                    left[i, j], right[i, j] = both[i, j], both[i, n + j]
            times(H, left, part)  # H W^-1 F
            change = 0.0
            for i in range(n):  # H += F' H W^-1 F
                for j in range(n):
                    total = 0.0
                    for k in range(n):
                        total += F[k, i] * part[k, j]
                    other[i, j] = total
            for i in range(n):
                for j in range(n):
                    H[i, j] += 0.5 * (other[i, j] + other[j, i])
                change = max(change, other[i, i] / (H[i, i] + 1e-300))
            times(F, right, part)  # G += F W^-1 G F'
            for i in range(n):
                for j in range(n):
                    total = 0.0
                    for k in range(n):
                        total += part[i, k] * F[j, k]
                    other[i, j] = total
            for i in range(n):
                for j in range(n):
                    G[i, j] += 0.5 * (other[i, j] + other[j, i])
            times(F, left, part)  # F = F W^-1 F
            for i in range(n):
                for j in range(n):
                    F[i, j] = part[i, j]
            if change < _CONVERGED:
                break
        total = white
        for i in range(n):
            for j in range(n):
                total += C[i] * H[i, j] * C[j]
        variance[b], covariance[b] = total, H
        for i in range(n):
            gain = 0.0
            for j in range(n):
                for k in range(n):
                    gain += A[b, i, j] * H[j, k] * C[k]
            K[b, i] = gain / total
