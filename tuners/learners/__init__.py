"""Second stage: learners that predict the controller's coordinates from features.

Each module has a learner's settings, whose `fit` trains it, and the trained learner, which
predicts.  Learners see arrays alone: plants and recordings do not belong here.
"""

from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from tuners.learners.actor import Agent
from tuners.learners.batches import Batches, Progress
from tuners.learners.estimator import Estimator, EstimatorSettings
from tuners.learners.feedforward import FeedForward, FeedForwardSettings
from tuners.learners.gbm import GBM, GBMSettings
from tuners.learners.polynomial import Polynomial, PolynomialSettings
from tuners.learners.torch_module import TorchModule
from tuners.learners.trend import Trend, TrendSettings
from yawrate_env.plant import entry

Array = NDArray[np.float64]


class Learner(Protocol):
    """A trained second stage."""

    @property
    def width(self) -> int:
        """Number of features."""

    def __call__(self, X: Array) -> Array:
        """Predict (B, t) targets from (B, n) features."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays to save, of finite float64, float32, int64, uint8 or bool.

        A single number comes back as an array of one: take its ``item()``.
        """

    @classmethod
    def from_arrays(cls, arrays: dict[str, NDArray[Any]]) -> Self:
        """Rebuild from `arrays`, or ``ValueError`` where these do not go together."""


class Settings(Protocol):
    """A learner's hyperparameters."""

    def fit(
        self,
        training: Batches,
        validation: Batches,
        random_state: int,
        progress: Progress | None = None,
    ) -> Any:
        """Train on batches of (m, n) features and (m, t) targets; a `Learner`."""


LEARNERS: dict[str, Any] = {
    "gbm": GBM,
    "feedforward": FeedForward,
    "polynomial": Polynomial,
    "trend": Trend,
    "agent": Agent,
    "estimator": Estimator,
    "torch": TorchModule,
}
"""Trained second stages by the name that tuner files know; others by ``module:attribute``."""

_TYPES = ("float64", "float32", "int64", "uint8", "bool")
_OWN = GBMSettings, FeedForwardSettings, PolynomialSettings, TrendSettings
_REHEARSED = 64  # rows
_REMEDY = (
    "Give FeedForwardSettings, GBMSettings, PolynomialSettings, TrendSettings, "
    "TorchSettings(build), a regressor of scikit-learn, or a learner of your own (docs/plants.md)."
)


def settings_for(learner: Any) -> Settings:
    """Settings of a learner, which a regressor of scikit-learn becomes."""
    if hasattr(learner, "predict") and hasattr(learner, "get_params"):
        return EstimatorSettings(learner)
    if isinstance(learner, type) or not callable(getattr(learner, "fit", None)):
        raise ValueError(f"learner = {learner!r} cannot be trained. {_REMEDY}")
    return learner  # type: ignore[no-any-return]


def known_name(learner: Any) -> str:
    """Name of one of `LEARNERS`; empty for others."""
    return {kind: name for name, kind in LEARNERS.items()}.get(type(learner), "")


def name_of(learner: Any) -> str:
    """The name by which a tuner file knows a trained learner."""
    return known_name(learner) or entry.of(type(learner), "learner")


def learner_named(name: str, arrays: dict[str, NDArray[Any]]) -> Learner:
    """A trained learner from the name and arrays of a file."""
    kind = LEARNERS.get(name) or entry.attribute(name)
    found: Learner = kind.from_arrays(arrays)
    return found


def check_arrays(arrays: dict[str, NDArray[Any]]) -> None:
    """``ValueError`` for arrays that no file holds: of other types, or not finite."""
    for name, array in arrays.items():
        if array.dtype not in _TYPES or not np.isfinite(array).all():
            raise ValueError(f"{name} is not of finite numbers of a learner's types.")


def rehearse(settings: Settings, width: int, count: int) -> None:
    """Train a foreign learner on a few random rows, save and load it.

    ``ValueError`` where it cannot be trained, or does not come back as it was: better now than
    after the simulations.

    Parameters
    ----------
    width, count : int
        Numbers of features and of targets.
    """
    if type(settings) in _OWN:
        return
    rng = np.random.default_rng(0)
    X, T = rng.standard_normal((_REHEARSED, width)), rng.standard_normal((_REHEARSED, count))
    half = _REHEARSED // 2
    try:
        learner = settings.fit([(X[:half], T[:half])], [(X[half:], T[half:])], 0)
        arrays = {n: np.ascontiguousarray(array) for n, array in learner.arrays().items()}
        check_arrays(arrays)
        values = learner(X)
        again = learner_named(name_of(learner), arrays)(X)
    except Exception as error:
        why = " ".join(str(error).split()).removesuffix(".")
        raise ValueError(
            f"learner = {settings!r} fails a rehearsal of training, saving and loading: "
            f"{type(error).__name__}: {why}. {_REMEDY}"
        ) from error
    if np.shape(values) != (len(X), count) or not np.array_equal(values, again):
        raise ValueError(
            f"learner = {settings!r} predicts {np.shape(values)} before saving and something else "
            f"after loading, for {(len(X), count)} targets. Keep all that it needs in arrays()."
        )
