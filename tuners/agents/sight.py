"""What a learning agent sees and does in an environment: of vehicles, or of any plant.

Both are read as recordings of a plant with something known beside them.  A vehicle's
environment shows what its ``visible`` says, and may average samples.
"""

from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tuners.features import FirstStage, compressor
from tuners.tuner.recording import Recording
from tuners.tuner.training import compressor_named
from yawrate_env.env.interaction import VISIBLE
from yawrate_env.env.plant_env import PlantEnv, PlantVectorEnv, recordings
from yawrate_env.env.vector_env import PITuningVectorEnv
from yawrate_env.env.yaw_rate_env import PITuningEnv
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.yaw_rate import yaw_rate

Array = NDArray[np.float64]
Seen = tuple[Array, Array, float, Array]
"""Inputs (1 or B, N), outputs (B, N), their sampling time [s], and what is beside them (B, m)."""


class Sight(Protocol):
    """How an environment's observations are read."""

    plant: Plant
    decimate: int

    def __call__(self, obs: ArrayLike) -> tuple[Seen, bool]:
        """Recordings that observations show, and whether it was a single one."""

    def beside(self, theta: Array) -> Array:
        """What is known beside recordings of these parameters (B, p), (B, m)."""

    def compressor(self, name: str, **settings: Any) -> FirstStage:
        """A first stage by name."""


class VehicleSight:
    """Of a vehicle's environment."""

    def __init__(self, env: PITuningEnv | PITuningVectorEnv) -> None:
        self.plant, self.decimate = yaw_rate(env.task), env.decimate
        self.visible = VISIBLE[env.visible]

    def __call__(self, obs: ArrayLike) -> tuple[Seen, bool]:
        """Recordings that observations show, and whether it was a single one."""
        seen, single = Recording.of_observations(obs, self.plant.Ts * self.decimate)
        return (seen.u, seen.y, seen.Ts, seen.beside(self.visible)), single

    def beside(self, theta: Array) -> Array:
        """What is visible of the context."""
        return theta[:, self.plant.indices(self.visible)]

    def compressor(self, name: str, **settings: Any) -> FirstStage:
        """A first stage by name."""
        return compressor(name, **settings)


class PlantSight:
    """Of any plant's environment."""

    def __init__(self, env: PlantEnv | PlantVectorEnv) -> None:
        self.plant, self.decimate = env.plant, 1

    def __call__(self, obs: ArrayLike) -> tuple[Seen, bool]:
        """Recordings that observations show, and whether it was a single one."""
        u, y, theta, single = recordings(self.plant, obs)
        return (u, y, self.plant.Ts, self.beside(theta)), single

    def beside(self, theta: Array) -> Array:
        """What is measured."""
        return self.plant.measured_features(theta)

    def compressor(self, name: str, **settings: Any) -> FirstStage:
        """A first stage by name, set to suit the plant."""
        return compressor_named(self.plant, name, **settings)


def sight(env: Any) -> Sight:
    """That of an environment."""
    return PlantSight(env) if isinstance(env, PlantEnv | PlantVectorEnv) else VehicleSight(env)
