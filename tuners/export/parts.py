"""What of a tuner is exported: its plant and both trained stages.

A vehicle's tuner is taken as that of its `yawrate_env.vehicle.yaw_rate` plant.  What leaves Python answers as
`PlantTuner.gains` does, for recordings from rest and without offsets.
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre import Laguerre
from tuners.features.regularised import Regularised
from tuners.features.response import FrequencyResponse
from tuners.learners import Learner
from tuners.learners.actor import Agent
from tuners.learners.feedforward import FeedForward
from tuners.learners.trend import Trend
from tuners.tuner.coordinates import decode
from tuners.tuner.plant_tuner import PlantTuner
from tuners.tuner.tuner import Tuner
from tuners.tuner.two_stage import TwoStage
from yawrate_env.loop.design import Status
from yawrate_env.plant.parametrisation import LOG, PLAIN
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.yaw_rate import yaw_rate

Array = NDArray[np.float64]

OnLaguerre = Laguerre | Regularised | FrequencyResponse
"""First stages that start from the same sums: coefficients, and what is made of them."""

_EXPORTED = (
    "Export ts-ff-lag or ts-gbm-lag, ts-ff-lag-vx, or one trained with Laguerre features, as "
    "plants.train does it by default."
)


@dataclass(frozen=True, slots=True)
class Parts:
    """A tuner that can be exported.

    Attributes
    ----------
    plant : Plant
        What it was trained for.
    compressor : Laguerre, Regularised or FrequencyResponse
        First stage.
    learner : FeedForward, GBM or Trend
        Second stage.
    """

    plant: Plant
    compressor: OnLaguerre
    learner: Learner

    @classmethod
    def of(cls, tuner: Any) -> Self:
        """A tuner's, or ``ValueError`` where it cannot be exported; the message says why."""
        if not isinstance(tuner, Tuner | PlantTuner):
            raise ValueError(
                f"a {type(tuner).__name__} is not exported as a graph: target onnx needs a tuner "
                f"(--tuner). {_EXPORTED}"
            )
        if not isinstance(tuner, TwoStage | PlantTuner):
            raise ValueError(
                f"a tuner of kind {tuner.kind!r} is not exported: it is no two-stage tuner. "
                f"{_EXPORTED}"
            )
        stages = tuner.stages
        if not isinstance(stages.compressor, OnLaguerre):
            name = type(stages.compressor).__name__
            raise ValueError(
                f"a tuner of kind {tuner.kind!r} is not exported: its first stage is {name}, and "
                f"only those on Laguerre functions leave Python. {_EXPORTED}"
            )
        if isinstance(tuner, TwoStage):
            plant = yaw_rate(tuner.task, tuner.coordinates)
        else:
            plant = tuner.plant
        parts = cls(plant, stages.compressor, stages.learner)
        parts._check()
        return parts

    @property
    def features(self) -> int:
        """How many the first stage gives."""
        return feature_count(self.compressor)

    @property
    def width(self) -> int:
        """How many the learner takes: further ones come from what is measured."""
        return self.features + len(self.plant.measured_names)

    @property
    def laguerre(self) -> Laguerre:
        """The functions that the first stage fits."""
        return Laguerre(self.compressor.order, self.compressor.pole)

    def answer(self, features: Array, theta: Array) -> tuple[Array, NDArray[np.int64]]:
        """Gains (B, k) for features (B, n), and a `Status` each: what every export must give.

        Parameters
        ----------
        theta : (B, p) float64
            Parameters of which those that are measured are looked at.
        """
        X = np.concatenate([features, self.plant.measured_features(theta)], axis=1)
        finite = np.isfinite(X)
        values, coordinates = self.learner(np.where(finite, X, 0.0)), self.plant.parametrisation
        gains = np.where(finite.all(axis=1, keepdims=True), coordinates.decode(values), np.nan)
        status = np.zeros(len(values), np.int64)
        if coordinates.target is not None:
            status = decode(values, coordinates.target, "loop").status
        return gains, np.where(np.isfinite(gains).all(axis=1), status, int(Status.UNREACHABLE))

    def _check(self) -> None:
        coordinates, beside = self.plant.parametrisation, self.plant.measured_names
        if coordinates.target is None and coordinates.decode not in (LOG.decode, PLAIN.decode):
            raise ValueError(
                "the plant's coordinates are its own, and their decode is Python that no other "
                "program knows. Export with plants.LOG or plants.loop(target), or use the tuner "
                "in Python."
            )
        if (trained := _width(self.learner)) != self.width:
            raise ValueError(
                f"the learner has {trained} features, {self.features} of them from the recording "
                f"and {len(beside)} from what is measured: these are not all. Train it again for "
                "this plant."
            )


def feature_count(compressor: OnLaguerre) -> int:
    """How many features a first stage gives."""
    match compressor:
        case Laguerre():
            return compressor.order
        case Regularised():
            return len(compressor.directions)
        case FrequencyResponse():
            return 2 * compressor.points


def _width(learner: Learner) -> int:
    """Features that a learner was trained on."""
    if isinstance(learner, Trend | Agent):
        return len(learner.mean)
    if isinstance(learner, FeedForward):
        return int(learner.W1.shape[1])
    return int(learner.models[0].num_features())
