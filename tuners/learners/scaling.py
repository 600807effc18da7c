"""Standardised features and targets, for learners that need them alike in size."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env.validation import finite_array

Array = NDArray[np.float64]

_NAMES = "feature_mean", "feature_scale", "target_mean", "target_scale"


@dataclass(frozen=True, slots=True, eq=False)
class Scaling:
    """Means and deviations of n features and t targets."""

    feature_mean: Array
    feature_scale: Array
    target_mean: Array
    target_scale: Array

    @classmethod
    def of(cls, X: Array, T: Array) -> Self:
        """Of features (m, n) and targets (m, t)."""
        return cls(X.mean(axis=0), _deviation(X), T.mean(axis=0), _deviation(T))

    @classmethod
    def from_arrays(cls, arrays: dict[str, NDArray[Any]]) -> Self:
        """Rebuild from `arrays`, or ``ValueError`` where these do not go together."""
        found = [finite_array(name, arrays[name], shape=(None,)) for name in _NAMES]
        for i in (1, 3):
            finite_array(_NAMES[i], found[i], shape=found[i - 1].shape)
        return cls(*found)

    @property
    def width(self) -> int:
        """Number of features."""
        return len(self.feature_mean)

    @property
    def count(self) -> int:
        """Number of targets."""
        return len(self.target_mean)

    def features(self, X: Array) -> Array:
        """Features (B, n), standardised."""
        return np.asarray((X - self.feature_mean) / self.feature_scale)

    def targets(self, T: Array) -> Array:
        """Targets (B, t), standardised."""
        return np.asarray((T - self.target_mean) / self.target_scale)

    def from_targets(self, T: Array) -> Array:
        """Targets (B, t) from standardised ones."""
        return np.asarray(T * self.target_scale + self.target_mean)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays to save."""
        return {name: getattr(self, name) for name in _NAMES}


def _deviation(values: Array) -> Array:
    """Standard deviations of the columns, 1 for those that do not vary."""
    scale = values.std(axis=0)
    return np.where(scale > 0, scale, 1.0)
