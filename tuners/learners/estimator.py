"""Second stage: any regressor of scikit-learn, one for each target.

Trained estimators are kept in the format of skops, which holds no code: it names types, of which
those of scikit-learn, NumPy and SciPy are built again and all others are refused.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tuners.learners.batches import Batches, Progress, gathered
from tuners.learners.scaling import Scaling
from yawrate_env.compiled import cores

Array = NDArray[np.float64]

_ROWS_FOR_THREADS = 20_000
_KNOWN = "sklearn.", "numpy.", "scipy."


@dataclass(frozen=True, slots=True)
class EstimatorSettings:
    """A regressor to train, which stays as it is: clones of it are trained.

    Attributes
    ----------
    estimator : estimator
        With scikit-learn's interface; it sees standardised features and targets.
    """

    estimator: Any

    def fit(
        self,
        training: Batches,
        validation: Batches,
        random_state: int,
        progress: Progress | None = None,
    ) -> "Estimator":
        """Train on batches of (m, n) features and (m, t) targets; `validation` is not used."""
        from sklearn.base import clone
        from threadpoolctl import threadpool_limits

        X, T = gathered(training)
        scaling, models = Scaling.of(X, T), []
        X, T = scaling.features(X), scaling.targets(T)
        threads = cores() if len(X) >= _ROWS_FOR_THREADS else 1
        for k in range(T.shape[1]):
            model = clone(self.estimator)
            given = model.get_params().items()
            seeds = (name for name, v in given if name.endswith("random_state") and v is None)
            model.set_params(**dict.fromkeys(seeds, random_state))
            with threadpool_limits(threads):
                models.append(model.fit(X, T[:, k]))
            if progress is not None:
                progress(k + 1, T.shape[1])
        return Estimator(models, scaling)


class Estimator:
    """Trained regressors, one a target."""

    def __init__(self, models: Sequence[Any], scaling: Scaling) -> None:
        self.models, self.scaling = models, scaling

    @property
    def width(self) -> int:
        """Number of features."""
        return self.scaling.width

    def __call__(self, X: Array) -> Array:
        """Predict (B, t) targets from (B, n) features."""
        scaled = self.scaling.features(X)
        columns = [model.predict(scaled) for model in self.models]
        return self.scaling.from_targets(np.stack(columns, axis=1).astype(np.float64))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays to save, or ``ValueError`` for a type that could not be loaded."""
        from skops.io import dumps

        saved = self.scaling.arrays()
        for k, model in enumerate(self.models):
            content = dumps(model)
            _check_types(content)
            saved[f"model{k}.skops"] = np.frombuffer(content, dtype=np.uint8)
        return saved

    @classmethod
    def from_arrays(cls, arrays: dict[str, NDArray[Any]]) -> Self:
        """Rebuild from `arrays`, or ``ValueError`` where these do not go together."""
        from skops.io import loads

        scaling, models = Scaling.from_arrays(arrays), []
        for k in range(scaling.count):
            content = arrays[f"model{k}.skops"].tobytes()
            models.append(loads(content, trusted=_check_types(content)))
        return cls(models, scaling)


def _check_types(content: bytes) -> list[str]:
    """Types that skops does not know and that are trusted here; ``ValueError`` for others."""
    from skops.io import get_untrusted_types

    names: list[str] = get_untrusted_types(data=content)
    for name in names:
        if not name.startswith(_KNOWN):
            raise ValueError(
                f"estimator has a part of type {name}, which a file cannot hold. Use parts of "
                "scikit-learn, or a learner of your own (docs/plants.md)."
            )
    return names
