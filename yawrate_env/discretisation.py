"""Exact zero-order hold, batched, with exact derivatives.

``expm([[A, B], [0, 0]] Ts) = [[Ad, Bd], [0, 1]]`` (Van Loan, 1978), and the derivative
along dX is the upper right block of ``expm([[X, dX], [0, X]])`` (Higham, *Functions of
Matrices*, eq. 3.16).  The exponential is a Taylor series of order 16, scaled to norm
1/2 (remainder below 1e-19) and squared back.  Stacked matrix products were preferred
to ``scipy.linalg.expm``, which spends more on one plant than an episode costs, and to
a compiled loop, which was no faster and took seconds to compile.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import kernel


@dataclass(frozen=True, slots=True, eq=False)
class DiscretePlant:
    """A batch of B strictly proper single-input single-output plants of order n.

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
    """

    A: NDArray[np.float64]
    B: NDArray[np.float64]
    C: NDArray[np.float64]
    Ts: float

    def __len__(self) -> int:
        return len(self.A)


@dataclass(frozen=True, slots=True, eq=False)
class ObserverForm:
    """Plants in the coordinates ``w_i = C M_{i-1} x`` with the fewest multiplications.

        y = w_1,   w_i+ = c w_i + w_{i+1} - alpha_i w_1 + beta_i u

    alpha and beta are the coefficients of denominator and numerator in powers of ``z - c``,
    highest first.  In z itself, slow poles would be differences of large numbers.

    Attributes
    ----------
    centre : NDArray
        (B,) c.
    alpha, beta : NDArray
        (B, n) coefficients.
    rows : NDArray
        (B, n, n) whose product with x is w.
    """

    centre: NDArray[np.float64]
    alpha: NDArray[np.float64]
    beta: NDArray[np.float64]
    rows: NDArray[np.float64]

    @classmethod
    def of(cls, plant: DiscretePlant, centre: float | None = None) -> Self:
        """Transform; no inverse is needed, so that every plant has this form.

        Parameters
        ----------
        centre : float, optional
            c for all; each plant's own mean of its poles if not given.
        """
        count, n = plant.B.shape
        c = np.trace(plant.A, axis1=1, axis2=2) / n
        if centre is not None:
            c = np.full_like(c, centre)
        alpha, beta = np.empty_like(plant.B), np.empty_like(plant.B)
        rows = np.empty((count, n, n), dtype=plant.B.dtype)
        A, B = np.ascontiguousarray(plant.A), np.ascontiguousarray(plant.B)
        _leverrier(A, B, np.ascontiguousarray(plant.C), c, alpha, beta, rows)
        return cls(c, alpha, beta, rows)

    def __len__(self) -> int:
        return len(self.alpha)


def zoh(
    A: NDArray[np.float64], B: NDArray[np.float64], C: NDArray[np.float64], Ts: float
) -> DiscretePlant:
    """Discretise (B, n, n), (B, n), (n,) continuous plants at `Ts` [s]."""
    E = expm(_augmented(A, B, Ts))
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
    count, p, n, _ = dA.shape
    size = n + 1
    X = np.zeros((count, p, 2 * size, 2 * size))
    X[:, :, :size, :size] = X[:, :, size:, size:] = _augmented(A, B, Ts)[:, None]
    X[:, :, :n, size : size + n] = dA * Ts
    dE = expm(X.reshape(-1, 2 * size, 2 * size)).reshape(X.shape)[:, :, :n, size:]
    return zoh(A, B, C, Ts), dE[..., :-1].copy(), dE[..., -1].copy()


def expm(X: NDArray[np.float64]) -> NDArray[np.float64]:
    """Exponentials of (K, m, m) matrices; one's result does not depend on the others."""
    norm = np.abs(X).sum(axis=1).max(axis=1)
    squarings = np.ceil(np.log2(np.maximum(2 * norm, 1.0))).astype(int)
    E = _taylor(X * (0.5**squarings)[:, None, None])
    for s in range(1, squarings.max(initial=0) + 1):
        rest = squarings >= s
        E[rest] = E[rest] @ E[rest]
    return E


def _taylor(X: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum of X^k / k! to k = 16 in six products (Paterson and Stockmeyer, 1973)."""
    c = 1 / np.cumprod([1.0, *range(1, 17)])
    eye = np.eye(X.shape[-1])
    X2 = X @ X
    X3, X4 = X2 @ X, X2 @ X2
    E = c[16] * X4
    for k in (12, 8, 4, 0):
        E = E + c[k] * eye + c[k + 1] * X + c[k + 2] * X2 + c[k + 3] * X3
        if k:
            E = E @ X4
    return np.asarray(E)


def _augmented(A: NDArray[np.float64], B: NDArray[np.float64], Ts: float) -> NDArray[np.float64]:
    X = np.zeros((len(A), A.shape[1] + 1, A.shape[1] + 1))
    X[:, :-1, :-1], X[:, :-1, -1] = A * Ts, B * Ts
    return X


@kernel
def _leverrier(
    A: NDArray[np.inexact],
    B: NDArray[np.inexact],
    C: NDArray[np.float64],
    centre: NDArray[np.inexact],
    alpha: NDArray[np.inexact],
    beta: NDArray[np.inexact],
    rows: NDArray[np.inexact],
) -> None:
    """Leverrier and Faddeev's recursion ``M_k = D M_{k-1} + alpha_k I`` for ``D = A - c I``."""
    n = B.shape[1]
    D, M, DM = np.empty_like(A[0]), np.empty_like(A[0]), np.empty_like(A[0])
    for b in range(len(A)):
        for i in range(n):
            for j in range(n):
                M[i, j] = 1.0 if i == j else 0.0
                D[i, j] = A[b, i, j] - centre[b] * M[i, j]
        for k in range(n):
            beta[b, k] = 0.0
            for j in range(n):
                rows[b, k, j] = 0.0
                for i in range(n):
                    rows[b, k, j] += C[i] * M[i, j]
                beta[b, k] += rows[b, k, j] * B[b, j]
            alpha[b, k] = 0.0
            for i in range(n):
                for j in range(n):
                    DM[i, j] = 0.0
                    for m in range(n):
                        DM[i, j] += D[i, m] * M[m, j]
                alpha[b, k] -= DM[i, i] / (k + 1.0)
            for i in range(n):
                for j in range(n):
                    M[i, j] = DM[i, j]
                M[i, i] += alpha[b, k]
