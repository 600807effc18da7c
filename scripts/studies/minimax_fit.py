"""Fit a polynomial for the worst plants of the prior instead of their mean.

A mean-square fit is Bayes' rule for the simulated prior: it gives up accuracy where plants are
hard for what it gains elsewhere.  The minimax rule (Lakshminarayanan and Rojas, 2022) has the least
largest risk; it is Bayes' rule for the least favourable prior.  That prior is found by
multiplicative weights (Freund and Schapire, 1999) over cells of the prior, whose weights grow with
their risks after every fit.  Risks are convex in a polynomial's coefficients, so the mean over
rounds comes as near to the minimax polynomial as rounds allow.

The loss is that of the metrics, linear about the right gains: ``|D (c - c*)|^2`` for coordinates c
and each plant's own slopes D.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.learners.polynomial import Polynomial, decorrelation, polynomial

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Minimax:
    """Settings of a fit.

    Attributes
    ----------
    degree : int
        Of the polynomial, 1 to 3.
    rounds : int
        Fits; the first one is for the mean risk over cells.
    rate : float
        How much the weight of the worst cell grows in a round, in logarithms.
    """

    degree: int = 2
    rounds: int = 300
    rate: float = 0.1

    def fit(self, X: Array, T: Array, slopes: Array, cells: NDArray[np.intp]) -> Polynomial:
        """Fit features (m, n) to targets (m, t) with slopes (m, f, t), each row of one cell."""
        mean, matrix = decorrelation([(X, T)])
        P = polynomial((X - mean) @ matrix, self.degree)
        risks = _Risks.of(P, T, slopes, cells)
        weights, total = np.full(len(risks.TT), 1 / len(risks.TT)), np.zeros(())
        best, least = np.zeros(()), np.inf
        for done in range(1, self.rounds + 1):
            found = risks.fitted(weights)
            total, risk = total + found, risks(found)
            for candidate in (found, total / done):
                if (worst := float(risks(candidate).max())) < least:
                    best, least = candidate, worst
            if risk.max() == 0:
                break
            weights = weights * np.exp(self.rate * risk / risk.max())
            weights = weights / weights.sum()
        return Polynomial(mean, matrix, best.reshape(T.shape[1], -1).T, self.degree)


@dataclass(frozen=True, slots=True, eq=False)
class _Risks:
    """Mean losses of coefficients in each of c cells, as quadratic forms."""

    PP: Array
    PT: Array
    TT: Array

    @classmethod
    def of(cls, P: Array, T: Array, slopes: Array, cells: NDArray[np.intp]) -> "_Risks":
        """Of monomials (m, k), for coefficients that are flat, (t k,)."""
        metric = np.einsum("mfa,mfb->mab", slopes, slopes)
        weighted = np.einsum("mab,mb->ma", metric, T)
        t, parts = T.shape[1], []
        for cell in np.unique(cells):
            r = np.flatnonzero(cells == cell)
            blocks = [[P[r].T @ (metric[r, a, b, None] * P[r]) for b in range(t)] for a in range(t)]
            right = np.concatenate([P[r].T @ weighted[r, a] for a in range(t)])
            energy = (weighted[r] * T[r]).sum()
            parts.append((np.block(blocks) / len(r), right / len(r), energy / len(r)))
        PP, PT, TT = (np.array(each) for each in zip(*parts, strict=True))
        return cls(PP, PT, TT)

    def fitted(self, weights: Array) -> Array:
        """Coefficients of the least weighted risk."""
        left, right = (np.tensordot(weights, part, 1) for part in (self.PP, self.PT))
        return np.asarray(np.linalg.lstsq(left, right, rcond=None)[0], dtype=np.float64)

    def __call__(self, coefficients: Array) -> Array:
        """Risks (c,)."""
        squares = (self.PP @ coefficients) @ coefficients
        return np.asarray(np.maximum(squares - 2 * self.PT @ coefficients + self.TT, 0.0))
