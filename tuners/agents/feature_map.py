"""Spaces of agents: standardised features of recordings to observe, unit actions to choose.

Two pure maps that wrappers, agents and exported data sets share.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tuners.features import Features, with_measured
from tuners.learners.actor import standardise
from yawrate_env.plant.action_bounds import action_bounds
from yawrate_env.plant.episodes import recorded
from yawrate_env.plant.parametrisation import Parametrisation, scale_to_bounds
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.decimation import averaged

Array = NDArray[np.float64]

_EPISODES = 512


@dataclass(frozen=True, slots=True, eq=False)
class FeatureMap:
    """Features of recordings and of known parameters, standardised and clipped.

    Attributes
    ----------
    features : Features
        First stage.
    mean, scale : NDArray
        (n,) over the prior.
    """

    features: Features
    mean: Array
    scale: Array

    @classmethod
    def of(
        cls,
        plant: Plant,
        features: Features,
        of_parameters: Callable[[Array], Array],
        decimate: int = 1,
    ) -> Self:
        """Standardise over episodes of the ``train`` set; gains play no part.

        Parameters
        ----------
        plant : Plant
            Its episodes are used.
        features : Features
            First stage.
        of_parameters : callable
            Parameters (B, p) to further features (B, m).
        decimate : int
            Coefficients depend on the sampling time: episodes are decimated as the recordings
            that follow are.
        """
        train = recorded(plant, "train", 0, _EPISODES)
        u, y = (averaged(x, decimate) for x in (train.u, train.y))
        known = of_parameters(train.theta)
        values, usable = with_measured(features, u, y, plant.Ts * decimate, known)
        if not usable.any():
            raise ValueError(
                f"features = {type(features).__name__} are usable in none of these episodes. "
                "Record for longer, with less noise, or choose other features."
            )
        values = values[usable]
        scale = values.std(axis=0)
        return cls(features, values.mean(axis=0), np.where(scale > 0, scale, 1.0))

    def raw(self, u: Array, y: Array, Ts: float, known: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Features (B, n) before standardising; as `tuners.features.with_measured`."""
        return with_measured(self.features, u, y, Ts, known)

    def __call__(
        self, u: Array, y: Array, Ts: float, known: Array
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Standardised features (B, n) float32; zero where they are not usable."""
        values, usable = self.raw(u, y, Ts, known)
        standard = standardise(values, self.mean, self.scale)
        return np.where(usable[:, None], standard, np.float32(0.0)), usable


@dataclass(frozen=True, slots=True, eq=False)
class ActionMap:
    """[-1, 1]^m to a plant's coordinates and on to gains.

    Attributes
    ----------
    low, high : NDArray
        (m,) coordinates that -1 and 1 stand for.
    parametrisation : Parametrisation
        The plant's.
    """

    low: Array
    high: Array
    parametrisation: Parametrisation

    @classmethod
    def of(cls, plant: Plant) -> Self:
        """All coordinates that an agent may choose."""
        return cls(*action_bounds(plant), plant.parametrisation)

    def gains(self, actions: NDArray[np.floating]) -> Array:
        """(B, m) in [-1, 1], clipped, to (B, k) gains."""
        return self.parametrisation.decode(scale_to_bounds(actions, self.low, self.high))

    def actions(self, gains: Array) -> Array:
        """(B, k) gains back to [-1, 1], clipped."""
        values = self.parametrisation.encode(gains)
        return np.asarray(np.clip(2 * (values - self.low) / (self.high - self.low) - 1, -1, 1))
