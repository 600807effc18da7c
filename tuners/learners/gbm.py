"""Second stage: gradient-boosted trees, one xgboost model a target.

Models are kept in xgboost's own binary JSON, and predict through its native interface:
the one for scikit-learn would bring in another dependency.
"""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tuners.learners.batches import Batches, Progress
from tuners.learners.trees import check_booster
from yawrate_env.compiled import cores
from yawrate_env.validation import finite_array

Array = NDArray[np.float64]

_ROWS_FOR_THREADS = 64
_ROWS_TO_TRAIN_WITH_THREADS = 20_000


@dataclass(frozen=True, slots=True)
class GBMSettings:
    """Hyperparameters, under xgboost's names and with the paper's values (section V-D)."""

    n_estimators: int = 2000
    max_depth: int = 7
    max_leaves: int = 10
    learning_rate: float = 0.1
    reg_lambda: float = 4.0
    min_child_weight: float = 25.0

    def fit(
        self,
        training: Batches,
        validation: Batches,
        random_state: int,
        progress: Progress | None = None,
    ) -> "GBM":
        """Train on batches of (m, n) features and (m, t) targets; `validation` is not used.

        A list of one batch is trained on in memory.  Of others only the targets are held there,
        and xgboost keeps the features' quantiles in a temporary file.
        """
        import xgboost

        if isinstance(training, list) and len(training) == 1:
            ((X, T),) = training
            # With a few thousand rows threads would wait for each other, and on a busy machine
            # for everybody else, a hundred times longer than they work.
            threads = cores() if len(X) >= _ROWS_TO_TRAIN_WITH_THREADS else 1
            return self._boosted(
                lambda t: xgboost.DMatrix(X, t), T, threads, random_state, progress
            )
        T = np.concatenate([t for _, t in training])
        with tempfile.TemporaryDirectory() as folder:

            def matrix(t: Array) -> Any:
                return _external(training, t, f"{folder}/cache")

            return self._boosted(matrix, T, cores(), random_state, progress)

    def _boosted(
        self,
        matrix: Callable[[Array], Any],
        T: Array,
        threads: int,
        random_state: int,
        progress: Progress | None,
    ) -> "GBM":
        """One model a target; `matrix` puts standardised labels (m,) to the features."""
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
            "nthread": threads,
        }
        models = []
        for k in range(T.shape[1]):
            scale = float(T[:, k].std()) or 1.0
            data = matrix((T[:, k] - T[:, k].mean()) / scale)
            models.append(xgboost.train(parameters, data, self.n_estimators))
            if progress is not None:
                progress(k + 1, T.shape[1])
        return GBM(models, T.mean(axis=0), T.std(axis=0))


def _external(batches: Batches, labels: Array, cache: str) -> Any:
    """Xgboost's matrix of batches, kept in files that begin with `cache`."""
    import xgboost

    class Parts(xgboost.DataIter):
        def reset(self) -> None:
            self.rest, self.first = iter(batches), 0

        def next(self, input_data: Callable[..., Any]) -> bool:
            X, _ = next(self.rest, (None, None))
            if X is None:
                return False
            last = self.first + len(X)
            input_data(data=X, label=labels[self.first : last])
            self.first = last
            return True

    return xgboost.ExtMemQuantileDMatrix(Parts(cache_prefix=cache))


class GBM:
    """Trained models.

    Targets are standardised before training: trees follow the scale of a target, but
    single precision and the default start of the boosting do not.
    """

    def __init__(self, models: list[Any], mean: Array, scale: Array) -> None:
        self.models, self.mean, self.scale = models, mean, scale

    @property
    def width(self) -> int:
        """Number of features."""
        return int(self.models[0].num_features())

    def __call__(self, X: Array) -> Array:
        """Predict (B, t) targets from (B, n) features."""
        threads = cores() if len(X) >= _ROWS_FOR_THREADS else 1
        for model in self.models:
            model.set_param({"nthread": threads})
        columns = [model.inplace_predict(X) for model in self.models]
        return np.asarray(np.stack(columns, axis=1) * self.scale + self.mean, dtype=np.float64)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays to save."""
        saved: dict[str, NDArray[Any]] = {"mean": self.mean, "scale": self.scale}
        for k, model in enumerate(self.models):
            saved[f"model{k}.ubj"] = np.frombuffer(model.save_raw("ubj"), dtype=np.uint8)
        return saved

    @classmethod
    def from_arrays(cls, arrays: dict[str, NDArray[Any]]) -> Self:
        """Rebuild from `arrays`, or ``ValueError`` where these do not go together."""
        import xgboost

        targets = len(finite_array("mean", arrays["mean"], shape=(None,)))
        finite_array("scale", arrays["scale"], shape=(targets,))
        models, widths = [], set()
        for name in (f"model{k}.ubj" for k in range(targets)):
            finite_array(name, arrays[name], shape=(None,))
            content = arrays[name].astype(np.uint8, casting="safe").tobytes()
            widths.add(check_booster(name, content))
            model = xgboost.Booster()
            model.load_model(bytearray(content))
            models.append(model)
        if len(widths) != 1:
            raise ValueError(f"mean: its {targets} models have {sorted(widths)} features.")
        return cls(models, arrays["mean"], arrays["scale"])
