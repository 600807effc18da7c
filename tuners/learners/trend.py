"""Second stage in two steps: a polynomial trend by least squares, and a learner of its residual.

Magnitude and phase of a controller are nearly linear in the recording's own frequency response
(`tuners.features.response`).  The trend fits that part, and the learner its residual from
the same decorrelated features (`tuners.learners.polynomial`).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tuners.learners import feedforward, gbm
from tuners.learners.batches import Batches, Progress
from tuners.learners.polynomial import decorrelation, polynomial
from yawrate_env.validation import count, finite_array

Array = NDArray[np.float64]

_RESTS: dict[str, Any] = {"gbm": gbm.GBM, "feedforward": feedforward.FeedForward}


@dataclass(frozen=True, slots=True)
class TrendSettings:
    """Hyperparameters.

    Attributes
    ----------
    rest : FeedForwardSettings or GBMSettings
        Learner of the trend's residual.
    degree : int
        Of the polynomial, 1 or 2.
    """

    rest: feedforward.FeedForwardSettings | gbm.GBMSettings
    degree: int = 1

    def fit(
        self,
        training: Batches,
        validation: Batches,
        random_state: int,
        progress: Progress | None = None,
    ) -> "Trend":
        """Train on batches of (m, n) features and (m, t) targets."""
        mean, matrix = decorrelation(training)
        normal = right = np.zeros(())
        for X, T in training:
            P = polynomial((X - mean) @ matrix, self.degree)
            normal, right = normal + P.T @ P, right + P.T @ T
        coefficients = np.asarray(np.linalg.lstsq(normal, right, rcond=None)[0], dtype=np.float64)
        rest, checked = (
            _Rest(data, mean, matrix, coefficients, self.degree) for data in (training, validation)
        )
        learner = self.rest.fit(rest, checked, random_state, progress)
        return Trend(mean, matrix, coefficients, self.degree, learner)


@dataclass(frozen=True, slots=True, eq=False)
class Trend:
    """A trained trend and the learner of its residual.

    Attributes
    ----------
    mean, matrix : NDArray
        (n,) and (n, k): features minus mean times matrix are decorrelated.
    coefficients : NDArray
        Of the polynomial, a column a target.
    degree : int
        Of the polynomial.
    rest : FeedForward or GBM
        Learner of the residual.
    """

    mean: Array
    matrix: Array
    coefficients: Array
    degree: int
    rest: feedforward.FeedForward | gbm.GBM

    @property
    def width(self) -> int:
        """Number of features."""
        return len(self.mean)

    def __call__(self, X: Array) -> Array:
        """Predict (B, t) targets from (B, n) features."""
        inputs = (X - self.mean) @ self.matrix
        return np.asarray(polynomial(inputs, self.degree) @ self.coefficients + self.rest(inputs))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays to save."""
        kinds = {kind: name for name, kind in _RESTS.items()}
        name = kinds[type(self.rest)]
        return {
            "mean": self.mean,
            "matrix": self.matrix,
            "coefficients": self.coefficients,
            "degree": np.array(self.degree),
            **{f"rest.{name}.{key}": array for key, array in self.rest.arrays().items()},
        }

    @classmethod
    def from_arrays(cls, arrays: dict[str, NDArray[Any]]) -> Self:
        """Rebuild from `arrays`, or ``ValueError`` where these do not go together."""
        own, rest, name = {}, {}, ""
        for key, array in arrays.items():
            if key.startswith("rest."):
                _, name, inner = key.split(".", 2)
                rest[inner] = array
            else:
                own[key] = array
        degree = count("degree", int(own.pop("degree").item()), at_most=2)
        n, k = np.shape(finite_array("matrix", own["matrix"], shape=(None, None)))
        monomials = 1 + k + (k * (k + 1) // 2 if degree == 2 else 0)
        finite_array("mean", own["mean"], shape=(n,))
        finite_array("coefficients", own["coefficients"], shape=(monomials, None))
        learner = _RESTS[name].from_arrays(rest)
        if learner.width != k:
            raise ValueError(f"matrix has {k} columns, and the learner {learner.width} features.")
        return cls(**own, degree=degree, rest=learner)


@dataclass(frozen=True, slots=True, eq=False)
class _Rest:
    """Batches of decorrelated features and of the targets' residuals from the trend."""

    batches: Batches
    mean: Array
    matrix: Array
    coefficients: Array
    degree: int

    def __iter__(self) -> Iterator[tuple[Array, Array]]:
        for X, T in self.batches:
            inputs = (X - self.mean) @ self.matrix
            yield inputs, T - polynomial(inputs, self.degree) @ self.coefficients
