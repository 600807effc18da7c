"""The benchmark: identify (mu_s, M_delta) from the recording, then apply the design rule."""

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tuners.trust.vehicle_identification import identify
from tuners.tuner.recording import Recording
from tuners.tuner.tuner import Tuner, nominal_context
from yawrate_env.loop.design import Design
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.plausible import LARGEST_SPEED


class GrayBox(Tuner):
    """Identify the vehicle, then design for it."""

    kind: ClassVar[str] = "gray-box"
    any_experiment = True

    @property
    def speed_range(self) -> tuple[float, float]:
        """Any that a car has: the equations of motion know what speed does."""
        return 0.0, LARGEST_SPEED

    def gains(self, recording: Recording) -> tuple[Design, NDArray[np.bool_]]:
        """Design for the identified vehicles."""
        found = identify(
            self.task.vehicle, recording, nominal_context(self.task.prior), self.speeds(recording)
        )
        return loops(self.task, found.context).design(), found.converged
