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
from tuners.learners.polynomial import Polynomial, least_squares
from yawrate_env.validation import count

Array = NDArray[np.float64]

HIGHEST = 2
"""Degree of the polynomial, at most: what is written in C."""

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

    def __post_init__(self) -> None:
        count("degree", self.degree, at_most=HIGHEST, remedy="Leave the rest to the learner.")

    def fit(
        self,
        training: Batches,
        validation: Batches,
        random_state: int,
        progress: Progress | None = None,
    ) -> "Trend":
        """Train on batches of (m, n) features and (m, t) targets."""
        trend = least_squares((training,), self.degree)
        rest, checked = (_Rest(data, trend) for data in (training, validation))
        return Trend(trend, self.rest.fit(rest, checked, random_state, progress))


@dataclass(frozen=True, slots=True, eq=False)
class Trend:
    """A trained trend and the learner of its residual.

    Attributes
    ----------
    polynomial : Polynomial
        The trend.
    rest : FeedForward or GBM
        Learner of the residual.
    """

    polynomial: Polynomial
    rest: feedforward.FeedForward | gbm.GBM

    @property
    def width(self) -> int:
        """Number of features."""
        return self.polynomial.width

    def __call__(self, X: Array) -> Array:
        """Predict (B, t) targets from (B, n) features."""
        inputs = self.polynomial.inputs(X)
        return np.asarray(self.polynomial.of_inputs(inputs) + self.rest(inputs))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays to save."""
        kinds = {kind: name for name, kind in _RESTS.items()}
        name = kinds[type(self.rest)]
        return {
            **self.polynomial.arrays(),
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
        trend = Polynomial.from_arrays(own)
        count("degree", trend.degree, at_most=HIGHEST)
        learner = _RESTS[name].from_arrays(rest)
        k = trend.matrix.shape[1]
        if learner.width != k:
            raise ValueError(f"matrix has {k} columns, and the learner {learner.width} features.")
        return cls(trend, learner)


@dataclass(frozen=True, slots=True, eq=False)
class _Rest:
    """Batches of decorrelated features and of the targets' residuals from the trend."""

    batches: Batches
    trend: Polynomial

    def __iter__(self) -> Iterator[tuple[Array, Array]]:
        for X, T in self.batches:
            inputs = self.trend.inputs(X)
            yield inputs, T - self.trend.of_inputs(inputs)
