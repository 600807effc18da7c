"""Second stage in two steps: a polynomial trend by least squares, the rest to a learner.

In loop coordinates what a controller must supply is nearly linear in the recording's own
frequency response (`tuners.response`).  The trend takes that; trees need no staircase and
neurons no bending to follow it, and learn what is left.  The learner gets the features
decorrelated: combinations that say little about the vehicle, but much about the noise in
the others, come out as large as these.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tuners import feedforward, gbm

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

LEARNERS: dict[str, Any] = {"gbm": gbm.GBM, "feedforward": feedforward.FeedForward}

_LEAST = 1e-8  # of the largest combination: smaller ones are constant, and left out


@dataclass(frozen=True, slots=True)
class TrendSettings:
    """Hyperparameters.

    Attributes
    ----------
    rest : FeedForwardSettings or GBMSettings
        Learns what the trend leaves.
    degree : int
        Of the polynomial, 1 or 2.
    """

    rest: feedforward.FeedForwardSettings | gbm.GBMSettings
    degree: int = 1

    def fit(
        self,
        X: Array,
        T: Array,
        X_val: Array,
        T_val: Array,
        random_state: int,
        progress: Progress | None = None,
    ) -> "Trend":
        """Train on (m, n) features and (m, 2) targets."""
        mean, scale = X.mean(axis=0), X.std(axis=0)
        standard = (X - mean) / np.where(scale > 0, scale, 1.0)
        _, size, axes = np.linalg.svd(standard, full_matrices=False)
        kept = size > _LEAST * size[0]
        rotation = (axes[kept] / size[kept, None]).T * np.sqrt(len(X))
        matrix = rotation / np.where(scale > 0, scale, 1.0)[:, None]
        inputs, checked = (X - mean) @ matrix, (X_val - mean) @ matrix
        coefficients = np.linalg.lstsq(polynomial(inputs, self.degree), T, rcond=None)[0]
        rests = (
            t - polynomial(x, self.degree) @ coefficients
            for x, t in ((inputs, T), (checked, T_val))
        )
        rest, rest_checked = rests
        learner = self.rest.fit(inputs, rest, checked, rest_checked, random_state, progress)
        return Trend(mean, matrix, coefficients, self.degree, learner)


@dataclass(frozen=True, slots=True, eq=False)
class Trend:
    """A trained trend and the learner of the rest.

    Attributes
    ----------
    mean, matrix : NDArray
        (n,) and (n, k): features minus mean times matrix are decorrelated.
    coefficients : NDArray
        Of the polynomial, a column a target.
    degree : int
        Of the polynomial.
    rest : FeedForward or GBM
        Learner of the rest.
    """

    mean: Array
    matrix: Array
    coefficients: Array
    degree: int
    rest: feedforward.FeedForward | gbm.GBM

    def __call__(self, X: Array) -> Array:
        """Predict (B, 2) targets from (B, n) features."""
        inputs = (X - self.mean) @ self.matrix
        return np.asarray(polynomial(inputs, self.degree) @ self.coefficients + self.rest(inputs))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Everything there is to save."""
        kinds = {kind: name for name, kind in LEARNERS.items()}
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
        """Rebuild from `arrays`."""
        own, rest, name = {}, {}, ""
        for key, array in arrays.items():
            if key.startswith("rest."):
                _, name, inner = key.split(".", 2)
                rest[inner] = array
            else:
                own[key] = array
        degree = int(own.pop("degree"))
        return cls(**own, degree=degree, rest=LEARNERS[name].from_arrays(rest))


def polynomial(x: Array, degree: int) -> Array:
    """Monomials up to `degree`, 1 or 2, of (B, k) inputs."""
    columns = [np.ones((len(x), 1)), x]
    if degree == 2:
        i, j = np.triu_indices(x.shape[1])
        columns.append(x[:, i] * x[:, j])
    return np.concatenate(columns, axis=1)
