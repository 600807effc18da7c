"""The parts of a tuner that exports write: its plant and both trained stages.

An export answers as the stages do, for recordings from rest and without offsets.
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tuners.export.first_stage import OnLaguerre, can_be_written, first_stage
from tuners.learners import Learner
from tuners.tuner.stages import Stages, coordinates_of
from tuners.tuner.tuner import Tuner
from yawrate_env.loop.design import Status, design_from_response
from yawrate_env.plant.parametrisation import Parametrisation, sign_of
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

_EXPORTED = (
    "Export ts-ff-lag, ts-gbm-lag, ts-ff-lag-vx, or a tuner with Laguerre features, as "
    "tuners.train(plant) gives by default."
)


@dataclass(frozen=True, slots=True)
class Parts:
    """A tuner that can be exported.

    Attributes
    ----------
    plant : Plant
        What it was trained for.
    features : Laguerre, Regularised or FrequencyResponse
        First stage.
    learner : FeedForward, GBM, Trend or Agent
        Second stage.
    parametrisation : Parametrisation
        Of the gains: what the learner predicts.
    """

    plant: Plant
    features: OnLaguerre
    learner: Learner
    parametrisation: Parametrisation

    @classmethod
    def of(cls, tuner: Any) -> Self:
        """A tuner's, or ``ValueError`` where it cannot be exported; the message says why."""
        if not isinstance(tuner, Tuner):
            raise ValueError(
                f"source is a {type(tuner).__name__}: target onnx needs a tuner (--tuner). "
                f"{_EXPORTED}"
            )
        stages = tuner.method
        if not isinstance(stages, Stages):
            raise ValueError(
                f"tuner {tuner!r} cannot be exported: its method is a "
                f"{type(stages).__name__}, not two stages. {_EXPORTED}"
            )
        stage = stages.features
        if not can_be_written(stage):
            raise ValueError(
                f"tuner {tuner!r} cannot be exported: its features are "
                f"{type(stage).__name__}, and only those on Laguerre functions can. "
                f"{_EXPORTED}"
            )
        plant = tuner.plant
        chosen = coordinates_of(plant, stages.parametrisation)
        parts = cls(plant, stage, stages.learner, chosen)
        parts._check()
        return parts

    @property
    def width(self) -> int:
        """How many features the learner takes: the recording's and the measured parameters."""
        return self.recorded + len(self.plant.measured_names)

    @property
    def recorded(self) -> int:
        """How many features a recording gives: of several channels, as many for every pair."""
        plant = self.plant
        return self.features.width * len(plant.inputs_named) * len(plant.outputs_named)

    def answer(self, features: Array, theta: Array) -> tuple[Array, NDArray[np.int64]]:
        """Gains (B, k) for features (B, n), and a `Status` each: what every export must give.

        Parameters
        ----------
        theta : (B, p) float64
            Parameters, of which the measured ones are used.
        """
        X = np.concatenate([features, self.plant.measured_features(theta)], axis=1)
        finite = np.isfinite(X)
        values, target = self.learner(np.where(finite, X, 0.0)), self.parametrisation.target
        decoded = self.parametrisation.decode(values)
        gains = np.where(finite.all(axis=1, keepdims=True), decoded, np.nan)
        status = np.full(len(values), int(Status.OK))
        if target is not None:
            with np.errstate(over="ignore"):  # features far from all that was learned
                status = design_from_response(values[:, 0], values[:, 1], target).status
        return gains, np.where(np.isfinite(gains).all(axis=1), status, int(Status.UNREACHABLE))

    @property
    def columns(self) -> tuple[tuple[str, float], ...]:
        """Kind and scale of each coordinate, where there is no loop."""
        columns = self.parametrisation.columns
        return columns * len(self.plant.gains) if len(columns) == 1 else columns

    @property
    def signs(self) -> tuple[int, ...]:
        """Signs of the gains; 0 of those that may have either, or be zero."""
        return tuple(sign_of(*each) for each in self.columns) or (1,) * len(self.plant.gains)

    def _check(self) -> None:
        if self.plant.rows > 2 and not first_stage(self.features).several:
            raise ValueError(
                f"features = {type(self.features).__name__} are exported of one input and one "
                "output, and of several where they are Laguerre coefficients. Train with those."
            )
        chosen = self.parametrisation
        if chosen.target is None and not chosen.columns:
            raise ValueError(
                "parametrisation: the plant has its own decode function, which no other program "
                "knows. Export with LOG, GAINS, signed, of_gains or loop(target), or use the "
                "tuner in Python."
            )
        if (trained := self.learner.width) != self.width:
            raise ValueError(
                f"the learner has {trained} features, but the recording gives "
                f"{self.recorded} and the measured parameters "
                f"{len(self.plant.measured_names)}. Train it again for this plant."
            )
