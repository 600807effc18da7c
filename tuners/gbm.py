"""Second stage: gradient-boosted trees, one xgboost model a target.

The six settings are the paper's (section V-D).  Models are kept in xgboost's own binary
JSON and predicted from through its native interface, whose scikit-learn face would
bring in another dependency.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import cores

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

_ROWS_FOR_THREADS = 64


@dataclass(frozen=True, slots=True)
class GBMSettings:
    """Hyperparameters; the paper's six, and the seed of xgboost's own choices."""

    n_estimators: int = 2000
    max_depth: int = 7
    max_leaves: int = 10
    learning_rate: float = 0.1
    reg_lambda: float = 4.0
    min_child_weight: float = 25.0

    def fit(
        self,
        X: Array,
        T: Array,
        X_val: Array,
        T_val: Array,
        random_state: int,
        progress: Progress | None = None,
    ) -> "GBM":
        """Train on (m, n) features and (m, 2) targets; the validation part is not used."""
        import xgboost

        parameters = {
            "objective": "reg:squarederror",
            "tree_method": "hist",
            "max_depth": self.max_depth,
            "max_leaves": self.max_leaves,
            "eta": self.learning_rate,
            "lambda": self.reg_lambda,
            "min_child_weight": self.min_child_weight,
            "seed": random_state,
            # A few thousand rows: threads would wait for each other, and on a busy machine
            # for everybody else, a hundred times longer than they work.
            "nthread": 1,
        }
        models = []
        for k in range(T.shape[1]):
            scale = float(T[:, k].std()) or 1.0
            data = xgboost.DMatrix(X, (T[:, k] - T[:, k].mean()) / scale)
            models.append(xgboost.train(parameters, data, self.n_estimators))
            if progress is not None:
                progress(k + 1, T.shape[1])
        return GBM(models, T.mean(axis=0), T.std(axis=0))


class GBM:
    """Trained models.

    Targets are standardised before training: trees follow the scale of a target, but
    single precision and the default start of the boosting do not.
    """

    def __init__(self, models: list[Any], mean: Array, scale: Array) -> None:
        self.models, self.mean, self.scale = models, mean, scale

    def __call__(self, X: Array) -> Array:
        """Predict (B, 2) targets from (B, n) features."""
        threads = cores() if len(X) >= _ROWS_FOR_THREADS else 1
        for model in self.models:
            model.set_param({"nthread": threads})
        columns = [model.inplace_predict(X) for model in self.models]
        return np.asarray(np.stack(columns, axis=1) * self.scale + self.mean, dtype=np.float64)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Everything there is to save."""
        saved: dict[str, NDArray[Any]] = {"mean": self.mean, "scale": self.scale}
        for k, model in enumerate(self.models):
            saved[f"model{k}.ubj"] = np.frombuffer(model.save_raw("ubj"), dtype=np.uint8)
        return saved

    @classmethod
    def from_arrays(cls, arrays: dict[str, NDArray[Any]]) -> Self:
        """Rebuild from `arrays`."""
        import xgboost

        models = []
        for k in range(len(arrays["mean"])):
            model = xgboost.Booster()
            model.load_model(bytearray(arrays[f"model{k}.ubj"].tobytes()))
            models.append(model)
        return cls(models, arrays["mean"], arrays["scale"])
