"""Exact zero-order hold, batched, with exact derivatives.

``expm([[A, B], [0, 0]] Ts) = [[Ad, Bd], [0, 1]]`` (Van Loan, 1978).  The exponential is a Taylor
series of order 16, scaled to norm 1/2 (remainder below 1e-19) and squared back;
``scipy.linalg.expm`` spends more on one plant than an episode costs.  Derivatives follow every
product by ``d(P Q) = P dQ + dP Q``: nothing cancels, so they are exact to rounding.

What the kernels need to compile counts: it is most of the time to a first answer.  They work on
real numbers only, and find their workspace allocated.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import kernel, over_blocks, subkernel

_COEFFICIENTS = 1 / np.cumprod([1.0, *range(1, 17)])
_BLOCK = 64


@dataclass(frozen=True, slots=True, eq=False)
class DiscretePlant:
    """A batch of B single-input single-output plants of order n.

        x[k+1] = A x[k] + B u[k - delay],   y[k] = C x[k] + D u[k - delay]

    Attributes
    ----------
    A : NDArray
        (B, n, n) transition matrices.
    B : NDArray
        (B, n) input columns.
    C : NDArray
        (n,) output row, the same for all.
    Ts : float
        Sampling time [s].
    D : NDArray, optional
        (B,) feedthrough of the delayed input, of plants with dead time
        (`yawrate_env.loop.dead_time`).
    delay : NDArray, optional
        (B,) int64, whole samples; both or neither is given.
    """

    A: NDArray[np.float64]
    B: NDArray[np.float64]
    C: NDArray[np.float64]
    Ts: float
    D: NDArray[np.float64] | None = None
    delay: NDArray[np.int64] | None = None

    def __len__(self) -> int:
        return len(self.A)


def zoh(
    A: NDArray[np.float64], B: NDArray[np.float64], C: NDArray[np.float64], Ts: float
) -> DiscretePlant:
    """Discretise (B, n, n), (B, n), (n,) continuous plants at `Ts` [s]."""
    E = expm(augmented(A, B, Ts))
    return DiscretePlant(E[:, :-1, :-1].copy(), E[:, :-1, -1].copy(), C, Ts)


def zoh_with_sensitivity(
    A: NDArray[np.float64],
    B: NDArray[np.float64],
    C: NDArray[np.float64],
    dA: NDArray[np.float64],
    Ts: float,
) -> tuple[DiscretePlant, NDArray[np.float64], NDArray[np.float64]]:
    """`zoh`, and the derivatives of its matrices with respect to p parameters of A.

    Parameters
    ----------
    dA : (B, p, n, n)
        Derivatives of `A`; `B` and `C` do not depend on the parameters.

    Returns
    -------
    plant : DiscretePlant
    dAd : (B, p, n, n)
    dBd : (B, p, n)
    """
    _, p, n, _ = dA.shape
    X = np.zeros((len(A), 1 + p, n + 1, n + 1))
    X[:, 0], X[:, 1:, :-1, :-1] = augmented(A, B, Ts), dA * Ts
    E = _exponentials(X)
    plant = DiscretePlant(E[:, 0, :-1, :-1].copy(), E[:, 0, :-1, -1].copy(), C, Ts)
    return plant, E[:, 1:, :-1, :-1].copy(), E[:, 1:, :-1, -1].copy()


def expm(X: NDArray[np.float64]) -> NDArray[np.float64]:
    """Exponentials of (K, m, m) matrices."""
    return _exponentials(X[:, None])[:, 0]


def _exponentials(X: NDArray[np.float64]) -> NDArray[np.float64]:
    """Exponentials and their p derivatives of (K, 1 + p, m, m) matrices and theirs."""
    norms = np.abs(X[:, 0]).sum(axis=1).max(axis=1)
    squarings = np.ceil(np.log2(np.maximum(2.0 * norms, 1.0))).astype(np.int64)
    E: NDArray[np.float64] = np.multiply(X, (0.5**squarings)[:, None, None, None], order="C")
    rows, size = E.reshape(len(E), math.prod(X.shape[1:])), X.shape[-1]

    def some(i: int, j: int) -> None:
        _expm(rows[i:j], size, squarings[i:j], _COEFFICIENTS, np.empty((5, rows.shape[1])))

    over_blocks(some, len(X), _BLOCK)
    return E


def augmented(A: NDArray[np.float64], B: NDArray[np.float64], Ts: float) -> NDArray[np.float64]:
    """The matrices ``[[A, B], [0, 0]] Ts``, (B, n + 1, n + 1)."""
    X = np.zeros((len(A), A.shape[1] + 1, A.shape[1] + 1))
    X[:, :-1, :-1], X[:, :-1, -1] = A * Ts, B * Ts
    return X


@subkernel
def _multiply(
    P: NDArray[np.float64], Q: NDArray[np.float64], size: int, out: NDArray[np.float64]
) -> None:
    """A product and its derivatives, (1 + p) m m numbers."""
    square = size * size
    for q in range(0, len(P), square):
        for i in range(0, square, size):
            for j in range(size):
                total = 0.0
                for k in range(size):
                    total += P[i + k] * Q[q + k * size + j]
                if q > 0:
                    for k in range(size):
                        total += P[q + i + k] * Q[k * size + j]
                out[q + i + j] = total


@kernel
def _expm(
    X: NDArray[np.float64],
    size: int,
    squarings: NDArray[np.int64],
    c: NDArray[np.float64],
    work: NDArray[np.float64],
) -> None:
    """Sum of X^k / k! to k = 16 in six products (Paterson and Stockmeyer, 1973), and squares.

    Matrices and their derivatives lie in rows of X (K, (1 + p) m m), which become the results.
    """
    width = X.shape[1]
    for b in range(len(X)):
        X1 = X[b]
        for q in range(width):
            work[0, q] = X1[q]
        for left, right in ((0, 0), (1, 0), (1, 1)):
            _multiply(work[left], work[right], size, work[left + right + 1])
        for q in range(width):
            work[4, q] = c[16] * work[3, q]
        for k in (12, 8, 4, 0):
            for q in range(width):
                total = work[4, q] + c[k + 1] * work[0, q]
                total += c[k + 2] * work[1, q]
                X1[q] = total + c[k + 3] * work[2, q]
            for i in range(0, size * size, size + 1):
                X1[i] += c[k]
            if k > 0:
                _multiply(X1, work[3], size, work[4])
        for _ in range(squarings[b]):
            _multiply(X1, X1, size, work[4])
            for q in range(width):
                X1[q] = work[4, q]
