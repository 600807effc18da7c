"""The observer form of plants, batched, with exact derivatives.

Coefficients of the characteristic polynomial follow from Leverrier and Faddeev's recursion, which
needs no inverse; derivatives follow every product by ``d(P Q) = P dQ + dP Q``.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import kernel, over_blocks
from yawrate_env.loop.discretisation import DiscretePlant

_BLOCK = 64


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
        dalpha, dbeta = np.empty_like(dBd), np.empty_like(dBd)
        _recursion(plant.A, plant.B, plant.C, self.centre, (dAd, dBd, dalpha, dbeta))
        return dalpha, dbeta

    def __len__(self) -> int:
        return len(self.alpha)


def polynomials(
    A: NDArray[np.float64],
    B: NDArray[np.float64],
    C: NDArray[np.float64],
    centre: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """alpha, beta and rows of the observer form; C (n,) or (B, n)."""
    nothing = np.empty((len(B), 0, *A.shape[1:])), np.empty((len(B), 0, B.shape[1]))
    return _recursion(A, B, C, centre, (*nothing, nothing[1], nothing[1]))


_Derivatives = tuple[
    NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]
]
"""Of A (B, p, n, n), B, alpha and beta (B, p, n each); the last two are written."""


def _recursion(
    A: NDArray[np.float64],
    B: NDArray[np.float64],
    C: NDArray[np.float64],
    centre: NDArray[np.float64],
    derivatives: _Derivatives,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    A, B = np.ascontiguousarray(A), np.ascontiguousarray(B)
    C = C[None].repeat(len(B), axis=0) if C.ndim == 1 else np.ascontiguousarray(C)
    alpha, beta, rows = np.empty_like(B), np.empty_like(B), np.empty_like(A)
    dA, dB, dalpha, dbeta = derivatives
    dA, dB = np.ascontiguousarray(dA), np.ascontiguousarray(dB)

    def some(i: int, j: int) -> None:
        work = np.empty((B.shape[1] + 4, *A.shape[1:]))
        _leverrier(
            *(A[i:j], B[i:j], C[i:j], centre[i:j], alpha[i:j], beta[i:j], rows[i:j]),
            *(dA[i:j], dB[i:j], dalpha[i:j], dbeta[i:j], work),
        )

    over_blocks(some, len(A), _BLOCK)
    return alpha, beta, rows


@kernel
def _leverrier(
    A: NDArray[np.float64],
    B: NDArray[np.float64],
    C: NDArray[np.float64],
    centre: NDArray[np.float64],
    alpha: NDArray[np.float64],
    beta: NDArray[np.float64],
    rows: NDArray[np.float64],
    dA: NDArray[np.float64],
    dB: NDArray[np.float64],
    dalpha: NDArray[np.float64],
    dbeta: NDArray[np.float64],
    work: NDArray[np.float64],
) -> None:
    """Leverrier and Faddeev's recursion ``M_k = D M_{k-1} + alpha_k I`` for ``D = A - c I``.

    Its derivatives follow from ``dM_k = dA M_{k-1} + D dM_{k-1} + dalpha_k I``.
    """
    n = B.shape[1]
    D, dM, dDM = work[n + 1], work[n + 2], work[n + 3]
    for b in range(len(A)):
        for i in range(n):
            for j in range(n):
                one = 1.0 if i == j else 0.0
                work[0, i, j], D[i, j] = one, A[b, i, j] - centre[b] * one
        for k in range(n):
            M, DM = work[k], work[k + 1]
            total = 0.0
            for j in range(n):
                row = 0.0
                for i in range(n):
                    row += C[b, i] * M[i, j]
                rows[b, k, j] = row
                total += row * B[b, j]
            beta[b, k] = total
            trace = 0.0
            for i in range(n):
                for j in range(n):
                    total = 0.0
                    for m in range(n):
                        total += D[i, m] * M[m, j]
                    DM[i, j] = total
                trace -= DM[i, i] / (k + 1.0)
            for i in range(n):
                DM[i, i] += trace
            alpha[b, k] = trace
        for q in range(dA.shape[1]):
            for i in range(n):
                for j in range(n):
                    dM[i, j] = 0.0
            for k in range(n):
                M = work[k]
                total = 0.0
                for j in range(n):
                    slope = 0.0
                    for i in range(n):
                        slope += C[b, i] * dM[i, j]
                    total += slope * B[b, j] + rows[b, k, j] * dB[b, q, j]
                dbeta[b, q, k] = total
                trace = 0.0
                for i in range(n):
                    for j in range(n):
                        total = 0.0
                        for m in range(n):
                            total += D[i, m] * dM[m, j] + dA[b, q, i, m] * M[m, j]
                        dDM[i, j] = total
                    trace -= dDM[i, i] / (k + 1.0)
                dalpha[b, q, k] = trace
                for i in range(n):
                    for j in range(n):
                        dM[i, j] = dDM[i, j]
                    dM[i, i] += trace
