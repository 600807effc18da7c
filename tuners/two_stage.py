"""The two-stage tuner: compress the episode, then predict the controller."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from tuners import coordinates
from tuners.compressors import FirstStage, compressor, conditioned, described
from tuners.feedforward import FeedForward, FeedForwardSettings
from tuners.gbm import GBM, GBMSettings
from tuners.recording import Recording
from tuners.response import FrequencyResponse
from tuners.trend import Trend, TrendSettings
from tuners.tuner import Tuner, task_from
from yawrate_env.design import Design
from yawrate_env.task import Task

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

LEARNERS: dict[str, Any] = {"gbm": GBM, "feedforward": FeedForward, "trend": Trend}


class Learner(Protocol):
    """Second stage, trained: features (B, n) to targets (B, 2)."""

    def __call__(self, X: Array) -> Array:
        """Predict."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Everything there is to save."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """A two-stage tuner before training; every combination is allowed.

    Attributes
    ----------
    compressor : Armax or Laguerre
        First stage.
    learner : GBMSettings, FeedForwardSettings or TrendSettings
        Second stage.
    coordinates : {"loop", "gains"}
        What is predicted.
    noise_draws : int
        Recordings of every simulated vehicle, with fresh noise.
    vehicles : int
        Simulated vehicles that it is usually trained on.
    v_x : tuple of float
        Speeds that it is usually trained for [m/s]; a range makes the speed a feature.
    """

    compressor: FirstStage
    learner: GBMSettings | FeedForwardSettings | TrendSettings
    coordinates: str = "loop"
    noise_draws: int = 1
    vehicles: int = 1500
    v_x: tuple[float, float] = (20.0, 20.0)


class TwoStage(Tuner):
    """A trained two-stage tuner.

    Parameters
    ----------
    task : Task
        What it was trained for.
    compressor : Compressor
        First stage.
    learner : Learner
        Second stage.
    coordinates : {"loop", "gains"}
        What the learner predicts.
    training : dict
        How it was trained, kept for the record.
    """

    kind: ClassVar[str] = "two-stage"

    def __init__(
        self,
        task: Task,
        compressor: FirstStage,
        learner: FeedForward | GBM | Trend,
        coordinates: str,
        training: dict[str, Any],
    ) -> None:
        super().__init__(task)
        self.compressor, self.learner = compressor, learner
        self.coordinates, self.training = coordinates, training
        self.any_experiment = isinstance(compressor, FrequencyResponse)

    def gains(self, recording: Recording) -> tuple[Design, NDArray[np.bool_]]:
        """Compress, predict, convert."""
        features, usable = self.compressor(recording.u, recording.y, recording.Ts)
        features = conditioned(features, self.task.prior, self.speeds(recording))
        features = np.where(np.isfinite(features), features, 0.0)
        design = coordinates.decode(self.learner(features), self.task.target, self.coordinates)
        return design, usable

    def settings(self) -> dict[str, Any]:
        """Task, both stages' settings and how it was trained."""
        learners = {kind: name for name, kind in LEARNERS.items()}
        return {
            **super().settings(),
            "compressor": described(self.compressor),
            "learner": learners[type(self.learner)],
            "coordinates": self.coordinates,
            "training": self.training,
        }

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The learner's."""
        return self.learner.arrays()

    @classmethod
    def from_file(cls, settings: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> Self:
        """Rebuild from what was saved."""
        return cls(
            task_from(settings),
            compressor(**settings["compressor"]),
            LEARNERS[settings["learner"]].from_arrays(arrays),
            settings["coordinates"],
            settings["training"],
        )
