"""Exact zero-order hold, batched, with exact derivatives.

``expm([[A, B], [0, 0]] Ts) = [[Ad, Bd], [0, 1]]`` (Van Loan, 1978).  Derivatives are the
imaginary parts of the same formulas after an imaginary step too small to be seen in the
real part (Squire and Trapp, 1998): nothing cancels, so they are exact to rounding, and
nothing is written twice.  The exponential is a Taylor series of order 16, scaled to norm
1/2 (remainder below 1e-19) and squared back; ``scipy.linalg.expm`` spends more on one
plant than an episode costs.
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import kernel, over_blocks

_STEP = 1e-40j
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
        c = np.trace(plant.A, axis1=1, axis2=2) / plant.A.shape[1]
        if centre is not None:
            c = np.full_like(c, centre)
        return cls(c, *polynomials(plant.A, plant.B, plant.C, c))

    def sensitivity(
        self, plant: DiscretePlant, dAd: NDArray[np.float64], dBd: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Derivatives of alpha and beta, (B, p, n) each, where the centre stays.

        Parameters
        ----------
        plant : DiscretePlant
            What this is the form of.
        dAd, dBd : (B, p, n, n), (B, p, n) float64
            Derivatives of its matrices.
        """
        _, p, n = dBd.shape
        A = (plant.A[:, None] + _STEP * dAd).reshape(-1, n, n)
        B = (plant.B[:, None] + _STEP * dBd).reshape(-1, n)
        alpha, beta, _ = polynomials(A, B, plant.C, np.repeat(self.centre, p))
        return _derivative(alpha).reshape(dBd.shape), _derivative(beta).reshape(dBd.shape)

    def __len__(self) -> int:
        return len(self.alpha)


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
    moved = (A[:, None] + _STEP * dA).reshape(-1, n, n)
    dE = _derivative(expm(augmented(moved, np.repeat(B, p, axis=0), Ts)))
    dE = dE.reshape(-1, p, n + 1, n + 1)[:, :, :n]
    return zoh(A, B, C, Ts), dE[..., :-1].copy(), dE[..., -1].copy()


def expm(X: NDArray[Any]) -> NDArray[Any]:
    """Exponentials of (K, m, m) matrices, real or complex."""
    E, inputs = np.empty_like(X), np.ascontiguousarray(X)
    over_blocks(lambda i, j: _expm(inputs[i:j], _COEFFICIENTS, E[i:j]), len(X), _BLOCK)
    return E


def augmented(A: NDArray[Any], B: NDArray[Any], Ts: float) -> NDArray[Any]:
    """The matrices ``[[A, B], [0, 0]] Ts``, (B, n + 1, n + 1)."""
    X = np.zeros((len(A), A.shape[1] + 1, A.shape[1] + 1), A.dtype)
    X[:, :-1, :-1], X[:, :-1, -1] = A * Ts, B * Ts
    return X


def _derivative(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    return np.asarray(values.imag / _STEP.imag)


def polynomials(
    A: NDArray[Any], B: NDArray[Any], C: NDArray[np.float64], centre: NDArray[np.float64]
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """alpha, beta and rows of the observer form, of real or complex matrices; C (n,) or (B, n)."""
    A, B = np.ascontiguousarray(A), np.ascontiguousarray(B)
    C = C[None].repeat(len(B), axis=0) if C.ndim == 1 else np.ascontiguousarray(C)
    alpha, beta, rows = np.empty_like(B), np.empty_like(B), np.empty_like(A)

    def some(i: int, j: int) -> None:
        _leverrier(A[i:j], B[i:j], C[i:j], centre[i:j], alpha[i:j], beta[i:j], rows[i:j])

    over_blocks(some, len(A), _BLOCK)
    return alpha, beta, rows


@kernel
def _multiply(P: NDArray[Any], Q: NDArray[Any], out: NDArray[Any]) -> None:
    for i in range(len(P)):
        for j in range(len(P)):
            out[i, j] = 0.0
        for k in range(len(P)):
            for j in range(len(P)):
                out[i, j] += P[i, k] * Q[k, j]


@kernel
def _expm(X: NDArray[Any], c: NDArray[np.float64], out: NDArray[Any]) -> None:
    """Sum of X^k / k! to k = 16 in six products (Paterson and Stockmeyer, 1973), and squares."""
    size = X.shape[1]
    work = np.empty((6, size, size), X.dtype)
    X1, X2, X3, X4, E, other = work[0], work[1], work[2], work[3], work[4], work[5]
    for b in range(len(X)):
        norm = 0.0
        for j in range(size):
            column = 0.0
            for i in range(size):
                column += abs(X[b, i, j])
            norm = max(norm, column)
        squarings = int(np.ceil(np.log2(max(2.0 * norm, 1.0))))
        for i in range(size):
            for j in range(size):
                X1[i, j] = X[b, i, j] * 0.5**squarings
        _multiply(X1, X1, X2)
        _multiply(X2, X1, X3)
        _multiply(X2, X2, X4)
        for i in range(size):
            for j in range(size):
                other[i, j] = c[16] * X4[i, j]
        for k in (12, 8, 4, 0):
            for i in range(size):
                for j in range(size):
                    E[i, j] = other[i, j] + c[k + 1] * X1[i, j] + c[k + 2] * X2[i, j]
                    E[i, j] += c[k + 3] * X3[i, j]
                E[i, i] += c[k]
            if k > 0:
                _multiply(E, X4, other)
        for _ in range(squarings):
            _multiply(E, E, other)
            E, other = other, E
        for i in range(size):
            for j in range(size):
                out[b, i, j] = E[i, j]


@kernel
def _leverrier(
    A: NDArray[Any],
    B: NDArray[Any],
    C: NDArray[np.float64],
    centre: NDArray[np.float64],
    alpha: NDArray[Any],
    beta: NDArray[Any],
    rows: NDArray[Any],
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
                    rows[b, k, j] += C[b, i] * M[i, j]
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
