"""The two ends of the scale: knowing the vehicle, and not looking at all."""

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tuners.tuner.recording import Recording
from tuners.tuner.tuner import Tuner, nominal_context
from yawrate_env.batch import take
from yawrate_env.loop.design import Design
from yawrate_env.vehicle.episode import loops


class Oracle(Tuner):
    """The design rule with the true vehicle, where the recording shows it."""

    kind: ClassVar[str] = "oracle"
    needs_motion: ClassVar[bool] = False

    def gains(self, recording: Recording) -> tuple[Design, NDArray[np.bool_]]:
        """Design for the true context."""
        if recording.context is None:
            raise ValueError(
                "The oracle must see the vehicle's true parameters. "
                'Use gymnasium.make("yawrate/PITuning-v0", visible="context").'
            )
        design = loops(self.task, recording.context).design()
        return design, np.ones(len(recording), dtype=np.bool_)


class Nominal(Tuner):
    """The fixed PI of the vehicle in the middle of the prior."""

    kind: ClassVar[str] = "nominal"
    needs_motion: ClassVar[bool] = False

    def gains(self, recording: Recording) -> tuple[Design, NDArray[np.bool_]]:
        """Same gains for all."""
        one = loops(self.task, nominal_context(self.task.prior)).design()
        everyone = np.zeros(len(recording), dtype=np.intp)
        return take(one, everyone), np.ones(len(recording), dtype=np.bool_)
