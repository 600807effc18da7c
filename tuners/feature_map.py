"""Observations to a few standardised numbers, and actions in [-1, 1] to gains.

What a learning agent needs around `yawrate/PITuning-v0`, as two pure maps; the
wrappers and the trained agent share them.
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tuners.compressors import FirstStage
from tuners.recording import Recording
from yawrate_env import controller
from yawrate_env.contexts import CONTEXT_SETS
from yawrate_env.decimation import averaged
from yawrate_env.design import required_response
from yawrate_env.episode import record
from yawrate_env.judge import Judge
from yawrate_env.task import Target, Task
from yawrate_env.vehicle import Context

Array = NDArray[np.float64]

LIMIT = 10.0
"""Standardised features are clipped here, so that the observation space is finite."""

_EPISODES = 512


@dataclass(frozen=True, slots=True, eq=False)
class FeatureMap:
    """Compress, append the visible context, standardise, clip.

    Attributes
    ----------
    compressor : FirstStage
        First stage.
    mean, scale : NDArray
        (n,) over the prior.
    visible : tuple of str
        Which of the context's values are features too.
    """

    compressor: FirstStage
    mean: Array
    scale: Array
    visible: tuple[str, ...]

    @classmethod
    def of(
        cls,
        task: Task,
        first_stage: FirstStage,
        visible: tuple[str, ...] = (),
        decimate: int = 1,
    ) -> Self:
        """Standardise over episodes of the ``train`` set; no gains are looked at.

        Coefficients depend on the sampling time, so these episodes are decimated like
        the ones to come.
        """
        draw = CONTEXT_SETS["train"].draw(task.prior, 0, 0, _EPISODES)
        u, y = (averaged(x, decimate) for x in record(task, draw))
        raw = cls(first_stage, np.zeros(1), np.ones(1), visible)
        values, usable = raw.raw(
            Recording(u, y, task.experiment.Ts * decimate, draw.context.v_x, draw.context)
        )
        if not usable.any():
            raise ValueError(
                f"{type(first_stage).__name__} finds no usable features in this task's episodes. "
                "Record for longer, at a higher snr_db, or use the other compressor."
            )
        values = values[usable]
        scale = values.std(axis=0)
        return cls(first_stage, values.mean(axis=0), np.where(scale > 0, scale, 1.0), visible)

    def raw(self, recording: Recording) -> tuple[Array, NDArray[np.bool_]]:
        """Features (B, n) before standardising, and where they are usable."""
        values, usable = self.compressor(recording.u, recording.y, recording.Ts)
        if not self.visible:
            return values, usable
        shown: Any = recording.context
        if shown is None:
            if recording.v_x is None or self.visible != ("v_x",):
                raise ValueError(f"The recording must come with {', '.join(self.visible)}.")
            shown = recording
        columns = [getattr(shown, name)[:, None] for name in self.visible]
        return np.concatenate([values, *columns], axis=1), usable

    def __call__(self, recording: Recording) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Standardised features (B, n) float32; zero where they are not usable."""
        values, usable = self.raw(recording)
        standard = np.clip((values - self.mean) / self.scale, -LIMIT, LIMIT)
        return np.where(usable[:, None], standard, 0.0).astype(np.float32), usable


@dataclass(frozen=True, slots=True)
class ActionMap:
    """[-1, 1]^2 to loop coordinates and on to gains.

    The ranges come from the plants of the prior: the magnitudes that a controller
    must be able to supply, half an octave to spare, and most of the phases that a PI has,
    or nearly all of them where the prior needs them.

    Attributes
    ----------
    low, high : tuple of float
        Of (log magnitude, phase [rad]).
    target : Target
        Where and how the controller's response is meant.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    target: Target

    @classmethod
    def of(cls, task: Task) -> Self:
        """Ranges for the prior of a task."""
        prior = task.prior
        grid = np.meshgrid(
            *(np.linspace(*ends, 3) for ends in (prior.mu_s, prior.M_delta, prior.v_x))
        )
        context = Context.of(*(axis.ravel() for axis in grid))
        plants = Judge.of(task, context).transfer_function
        magnitude, phase = required_response(plants, task.target)
        spare = 0.5 * np.log(2)
        steepest = np.clip(np.degrees(phase.min()) - 2.0, -89.0, -75.0)
        phases = np.radians([steepest, -0.5])
        return cls(
            (float(magnitude.min() - spare), float(phases[0])),
            (float(magnitude.max() + spare), float(phases[1])),
            task.target,
        )

    def gains(self, actions: NDArray[np.floating]) -> Array:
        """(B, 2) in [-1, 1], clipped, to (B, 2) of (kp, Ti)."""
        unit = (np.clip(np.asarray(actions, dtype=np.float64), -1, 1) + 1) / 2
        low, high = np.array(self.low), np.array(self.high)
        magnitude, phase = (low + (high - low) * unit).T
        return np.stack(controller.gains(magnitude, phase, self.target), axis=1)

    def actions(self, gains: Array) -> Array:
        """(B, 2) of (kp, Ti) back to [-1, 1], clipped."""
        low, high = np.array(self.low), np.array(self.high)
        kp, Ti = gains.T
        values = np.stack(controller.response(kp, Ti, self.target), axis=1)
        return np.asarray(np.clip(2 * (values - low) / (high - low) - 1, -1, 1))
