"""Second stage: a polynomial in decorrelated features, by least squares.

The controller's magnitude and phase are nearly linear in the recording's own response
(`tuners.features.response`), and a cubic in a dozen features follows them over friction, mass
and speed without a search: one linear problem, whose answer no start and no stop decide.

Features are decorrelated first: combinations of small variance, which hold little of the plant
but much of the noise in the others, are scaled up to the same variance as these.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import combinations_with_replacement
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tuners.learners.batches import Batches, Progress
from yawrate_env.validation import count, finite_array

Array = NDArray[np.float64]

HIGHEST = 3

_LEAST = 1e-12  # of the largest variance: combinations below it are constant, and left out
_ROWS = 4096


@dataclass(frozen=True, slots=True)
class PolynomialSettings:
    """Hyperparameters.

    Attributes
    ----------
    degree : int
        1 to 3.
    """

    degree: int = 3

    def __post_init__(self) -> None:
        count("degree", self.degree, at_most=HIGHEST, remedy="A cubic is the highest.")

    def fit(
        self,
        training: Batches,
        validation: Batches,
        random_state: int,
        progress: Progress | None = None,
    ) -> "Polynomial":
        """Fit to batches of (m, n) features and (m, t) targets, those that validate too."""
        return least_squares((training, validation), self.degree)


@dataclass(frozen=True, slots=True, eq=False)
class Polynomial:
    """A fitted polynomial.

    Attributes
    ----------
    mean, matrix : NDArray
        (n,) and (n, k): features minus mean times matrix are decorrelated.
    coefficients : NDArray
        (monomials, t), in the order of `polynomial`.
    degree : int
        1 to 3.
    """

    mean: Array
    matrix: Array
    coefficients: Array
    degree: int

    @property
    def width(self) -> int:
        """Number of features."""
        return len(self.mean)

    def __call__(self, X: Array) -> Array:
        """Predict (B, t) targets from (B, n) features."""
        return self.of_inputs(self.inputs(X))

    def inputs(self, X: Array) -> Array:
        """Decorrelated features (B, k) of (B, n) features."""
        return np.asarray((X - self.mean) @ self.matrix)

    def of_inputs(self, inputs: Array) -> Array:
        """Predict (B, t) targets from (B, k) decorrelated features."""
        return np.asarray(polynomial(inputs, self.degree) @ self.coefficients)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays to save."""
        return {
            "mean": self.mean,
            "matrix": self.matrix,
            "coefficients": self.coefficients,
            "degree": np.array(self.degree),
        }

    @classmethod
    def from_arrays(cls, arrays: dict[str, NDArray[Any]]) -> Self:
        """Rebuild from `arrays`, or ``ValueError`` where these do not go together."""
        degree = count("degree", int(arrays["degree"].item()), at_most=HIGHEST)
        n, k = np.shape(finite_array("matrix", arrays["matrix"], shape=(None, None)))
        finite_array("mean", arrays["mean"], shape=(n,))
        monomials = polynomial(np.zeros((1, k)), degree).shape[1]
        finite_array("coefficients", arrays["coefficients"], shape=(monomials, None))
        return cls(arrays["mean"], arrays["matrix"], arrays["coefficients"], degree)


def least_squares(parts: Sequence[Batches], degree: int) -> Polynomial:
    """The polynomial with the least sum of squared errors over all batches of all parts."""
    mean, matrix = decorrelation(pair for batches in parts for pair in batches)
    normal = right = np.zeros(())
    for batches in parts:
        for X, T in batches:
            for i in range(0, len(X), _ROWS):
                P = polynomial((X[i : i + _ROWS] - mean) @ matrix, degree)
                normal, right = normal + P.T @ P, right + P.T @ T[i : i + _ROWS]
    coefficients = np.asarray(np.linalg.lstsq(normal, right, rcond=None)[0], dtype=np.float64)
    return Polynomial(mean, matrix, coefficients, degree)


def polynomial(x: Array, degree: int) -> Array:
    """Monomials up to `degree`, 1 to 3, of (B, k) inputs, low degrees first."""
    columns = [np.ones((len(x), 1)), x]
    for d in range(2, degree + 1):
        factors = (x[:, each] for each in monomials(x.shape[1], d).T)
        columns.append(reduce(np.multiply, factors))
    return np.concatenate(columns, axis=1)


def monomials(k: int, degree: int) -> NDArray[np.int64]:
    """Which of k inputs are the factors of each monomial of a degree, (m, degree)."""
    return np.array(list(combinations_with_replacement(range(k), degree)), np.int64)


def decorrelation(batches: Batches) -> tuple[Array, Array]:
    """Mean (n,) and a matrix (n, k) that makes features uncorrelated with variance one."""
    rows = 0
    total = squares = np.zeros(())
    shift: Array | None = None  # near the mean, so that the squares keep their digits
    for X, _ in batches:
        shift = X.mean(axis=0) if shift is None else shift
        rows, total = rows + len(X), total + (X - shift).sum(axis=0)
        squares = squares + (X - shift).T @ (X - shift)
    assert shift is not None
    offset = total / rows
    covariance = squares / rows - np.outer(offset, offset)
    scale = np.sqrt(covariance.diagonal())
    scale = np.where(scale > 0, scale, 1.0)
    variances, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = variances > _LEAST * variances.max()
    return shift + offset, axes[:, kept] / np.sqrt(variances[kept]) / scale[:, None]
