"""Slopes of Kalman gains by what moves transition and noise; noise that is coloured at the gyro."""

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import kernel
from yawrate_env.vehicle.kalman import times

Array = NDArray[np.float64]

_DOUBLINGS = 30
_CONVERGED = 1e-4  # relative


def entry(rows: Array, alpha: Array, pole: Array) -> Array:
    """Where noise enters the states (B, n) to reach the output by the disturbance's pole alone.

    Its numerator is the vehicle's denominator: alpha's polynomial without that pole, given as its
    distance (B,) from the centre.
    """
    numerator = np.ones_like(alpha)
    for i in range(1, alpha.shape[1]):
        numerator[:, i] = alpha[:, i - 1] + pole * numerator[:, i - 1]
    return np.asarray(np.linalg.solve(rows, numerator[..., None])[..., 0])


def outer(v: Array) -> Array:
    """Products (B, n, n) of vectors (B, n) with themselves."""
    return v[:, :, None] * v[:, None]


@kernel
def gain_slopes(
    A: NDArray[np.float64],
    C: NDArray[np.float64],
    dA: NDArray[np.float64],
    dQ: NDArray[np.float64],
    K: NDArray[np.float64],
    variance: NDArray[np.float64],
    P: NDArray[np.float64],
    dK: NDArray[np.float64],
) -> None:
    """Slopes (B, p, n) of Kalman gains where transition and noise move, by doubling.

    With ``L = A - K C``: ``dP = L dP L' + dA P L' + L P dA' + dQ``, and
    ``dK = (dA P C' + L dP C') / variance``.
    """
    n, size = A.shape[1], dA.shape[1]
    L, M, T = np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    X, moved = np.empty((size, n, n)), np.empty((size, n, n))
    for b in range(len(A)):
        for i in range(n):
            for j in range(n):
                L[i, j] = M[i, j] = A[b, i, j] - K[b, i] * C[j]
        for p in range(size):
            times(dA[b, p], P[b], moved[p])
            for i in range(n):
                for j in range(n):
                    X[p, i, j] = dQ[b, p, i, j]
                    for k in range(n):
                        X[p, i, j] += moved[p, i, k] * L[j, k] + L[i, k] * moved[p, j, k]
        for _ in range(_DOUBLINGS):
            change, largest = 0.0, 1e-300
            for p in range(size):
                times(M, X[p], T)
                for i in range(n):
                    for j in range(n):
                        total = 0.0
                        for k in range(n):
                            total += T[i, k] * M[j, k]
                        X[p, i, j] += total
                        change, largest = max(change, abs(total)), max(largest, abs(X[p, i, j]))
            if change < _CONVERGED * largest:
                break
            times(M, M, T)
            for i in range(n):
                for j in range(n):
                    M[i, j] = T[i, j]
        for p in range(size):
            for i in range(n):
                dK[b, p, i] = 0.0
                for j in range(n):
                    back = moved[p, i, j]
                    for k in range(n):
                        back += L[i, k] * X[p, k, j]
                    dK[b, p, i] += back * C[j] / variance[b]
