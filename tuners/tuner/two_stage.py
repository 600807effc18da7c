"""The two-stage tuner for vehicles: compress the episode, then predict the controller."""

from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from tuners.features.response import FrequencyResponse
from tuners.tuner import coordinates
from tuners.tuner.recording import Recording
from tuners.tuner.stages import Stages
from tuners.tuner.tuner import Tuner, task_from
from yawrate_env.loop.design import Design
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import theta_of


class TwoStage(Tuner):
    """A trained two-stage tuner.

    Parameters
    ----------
    task : Task
        What it was trained for.
    stages : Stages
        Both, trained.
    coordinates : {"loop", "gains"}
        What the learner predicts.
    training : dict
        How it was trained, kept for the record.
    """

    kind: ClassVar[str] = "two-stage"

    def __init__(
        self,
        task: Task,
        stages: Stages,
        coordinates: str,
        training: dict[str, Any],
    ) -> None:
        super().__init__(task)
        self.stages, self.coordinates, self.training = stages, coordinates, training
        self.any_experiment = isinstance(stages.compressor, FrequencyResponse)

    def gains(self, recording: Recording) -> tuple[Design, NDArray[np.bool_]]:
        """Compress, predict, convert."""
        speeds = self.speeds(recording)
        beside = np.empty((len(speeds), 0))
        if self.plant.measured_names:
            beside = self.plant.measured_features(theta_of(Context(speeds, speeds, speeds)))
        values, usable = self.stages(recording.u, recording.y, recording.Ts, beside)
        return coordinates.decode(values, self.task.target, self.coordinates), usable

    def settings(self) -> dict[str, Any]:
        """Task, both stages' settings and how it was trained."""
        return {
            **super().settings(),
            **self.stages.settings(),
            "coordinates": self.coordinates,
            "training": self.training,
        }

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The learner's."""
        return self.stages.learner.arrays()

    @classmethod
    def from_file(cls, settings: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> Self:
        """Rebuild from what was saved."""
        return cls(
            task_from(settings),
            Stages.from_file(settings, arrays),
            settings["coordinates"],
            settings["training"],
        )
