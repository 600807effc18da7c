"""Recordings to a few standardised numbers, and actions in [-1, 1] to gains, for any plant.

What a learning agent needs around ``yawrate/Plant-v0`` or ``yawrate/PITuning-v0``, as two
pure maps; wrappers, agents and exported data sets share them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tuners.features import FirstStage
from tuners.learners.actor import standardised, stretched
from yawrate_env.plant.action_bounds import action_bounds
from yawrate_env.plant.episodes import recorded
from yawrate_env.plant.parametrisation import Coordinates
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.decimation import averaged

Array = NDArray[np.float64]

_EPISODES = 512


@dataclass(frozen=True, slots=True, eq=False)
class FeatureMap:
    """Compress, append what is known beside the recording, standardise, clip.

    Attributes
    ----------
    compressor : FirstStage
        First stage.
    mean, scale : NDArray
        (n,) over the prior.
    """

    compressor: FirstStage
    mean: Array
    scale: Array

    @classmethod
    def of(
        cls,
        plant: Plant,
        first_stage: FirstStage,
        beside: Callable[[Array], Array] | None = None,
        decimate: int = 1,
    ) -> Self:
        """Standardise over episodes of the ``train`` set; no gains are looked at.

        Parameters
        ----------
        plant : Plant
            Whose episodes.
        first_stage : FirstStage
            What compresses them.
        beside : callable, optional
            Parameters (B, p) to further features (B, m); by default what is measured.
        decimate : int
            Coefficients depend on the sampling time: episodes are decimated like the ones
            to come.
        """
        seen = recorded(plant, "train", 0, _EPISODES)
        u, y = (averaged(x, decimate) for x in (seen.u, seen.y))
        raw = cls(first_stage, np.zeros(1), np.ones(1)).raw
        values, usable = raw(
            u, y, plant.Ts * decimate, (beside or plant.measured_features)(seen.theta)
        )
        if not usable.any():
            raise ValueError(
                f"{type(first_stage).__name__} finds no usable features in these episodes. "
                "Record for longer, with less noise, or use another compressor."
            )
        values = values[usable]
        scale = values.std(axis=0)
        return cls(first_stage, values.mean(axis=0), np.where(scale > 0, scale, 1.0))

    def raw(self, u: Array, y: Array, Ts: float, beside: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Features (B, n) before standardising, and where they are usable.

        Parameters
        ----------
        u : (1, N) or (B, N) float64
            Inputs.
        y : (B, N) float64
            Measured outputs.
        Ts : float
            Sampling time [s].
        beside : (B, m) float64
            What is known beside the recordings.
        """
        values, usable = self.compressor(u, y, Ts)
        return np.concatenate([values, beside], axis=1), usable

    def __call__(
        self, u: Array, y: Array, Ts: float, beside: Array
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Standardised features (B, n) float32; zero where they are not usable."""
        values, usable = self.raw(u, y, Ts, beside)
        standard = standardised(values, self.mean, self.scale)
        return np.where(usable[:, None], standard, np.float32(0.0)), usable


@dataclass(frozen=True, slots=True, eq=False)
class ActionMap:
    """[-1, 1]^m to a plant's coordinates and on to gains.

    Attributes
    ----------
    low, high : NDArray
        (m,) coordinates that -1 and 1 stand for.
    coordinates : Coordinates
        The plant's.
    """

    low: Array
    high: Array
    coordinates: Coordinates

    @classmethod
    def of(cls, plant: Plant) -> Self:
        """All that is within an agent's reach."""
        return cls(*action_bounds(plant), plant.parametrisation)

    def gains(self, actions: NDArray[np.floating]) -> Array:
        """(B, m) in [-1, 1], clipped, to (B, k) gains."""
        return self.coordinates.decode(stretched(actions, self.low, self.high))

    def actions(self, gains: Array) -> Array:
        """(B, k) gains back to [-1, 1], clipped."""
        values = self.coordinates.encode(gains)
        return np.asarray(np.clip(2 * (values - self.low) / (self.high - self.low) - 1, -1, 1))
