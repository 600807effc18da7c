"""Wrappers that make `yawrate/PITuning-v0` and `yawrate/Plant-v0` ready to train on.

`Compressed` shows standardised features instead of the recording; `LoopAction` takes
actions in [-1, 1] and maps them to a vehicle's loop coordinates, or to a plant's own.  The
vector forms do the same to a batch, final observations included.
``yawrate/PITuningFeatures-v0`` and ``yawrate/PlantFeatures-v0`` have both.
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from tuners.agents.feature_map import ActionMap, FeatureMap
from tuners.agents.sight import sight
from tuners.learners.actor import LIMIT
from yawrate_env import ENV_ID, PLANT_ID, validation
from yawrate_env.env.nonlinear_env import PITuningNonlinearEnv, PITuningNonlinearVectorEnv
from yawrate_env.env.plant_env import PlantEnv, PlantVectorEnv
from yawrate_env.env.vector_env import PITuningVectorEnv
from yawrate_env.env.yaw_rate_env import PITuningEnv
from yawrate_env.plant.plant import Plant

SCALAR = PITuningEnv, PlantEnv
VECTOR = PITuningVectorEnv, PlantVectorEnv


class _ObservationFeatures:
    """What both observation wrappers do."""

    def __init__(self, env: Any, name: str, settings: dict[str, Any]) -> None:
        self.read = see = sight(env.unwrapped)
        first_stage = see.compressor(name, **settings)
        self.map = FeatureMap.of(see.plant, first_stage, see.beside, see.decimate)
        n = len(self.map.mean)
        self.space = Box(-LIMIT, LIMIT, (n,), dtype=np.float32)

    def __call__(self, obs: NDArray[np.float32]) -> NDArray[np.float32]:
        seen, single = self.read(obs)
        features, _ = self.map(*seen)
        return features[0] if single else features


class Compressed(gymnasium.ObservationWrapper, gymnasium.utils.RecordConstructorArgs):
    """Show standardised features of the recording.

    Parameters
    ----------
    env : gymnasium.Env
        ``yawrate/PITuning-v0`` or ``yawrate/Plant-v0``.
    compressor : {"laguerre", "armax", "response"}
        First stage; a plant's Laguerre functions are those of its default recipe.
    **settings
        The compressor's own, such as ``order=8``.
    """

    def __init__(
        self, env: gymnasium.Env[Any, Any], compressor: str = "laguerre", **settings: Any
    ) -> None:
        _require(env, SCALAR, "observation_space")
        gymnasium.utils.RecordConstructorArgs.__init__(self, compressor=compressor, **settings)
        gymnasium.ObservationWrapper.__init__(self, env)
        self._features = _ObservationFeatures(env, compressor, settings)
        self.map = self._features.map
        self.observation_space = self._features.space

    def observation(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Compress one recording."""
        return self._features(observation)


class LoopAction(gymnasium.ActionWrapper, gymnasium.utils.RecordConstructorArgs):
    """Take actions in [-1, 1]: the coordinates of a plant's controller.

    Those of a vehicle's are its log magnitude and phase at the crossover.
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        _require(env, SCALAR, "action_space")
        gymnasium.utils.RecordConstructorArgs.__init__(self)
        gymnasium.ActionWrapper.__init__(self, env)
        self.map = ActionMap.of(sight(env.unwrapped).plant)
        self.action_space = _unit_box(self.map)

    def action(self, action: NDArray[np.float32]) -> NDArray[np.float64]:
        """One action to gains."""
        given = validation.finite_array("action", action, shape=self.map.low.shape)
        return np.asarray(self.map.gains(given[None])[0])


class CompressedVector(VectorWrapper[Any, Any, Any, Any, Any]):
    """`Compressed` for the native batch environment."""

    def __init__(
        self, env: VectorEnv[Any, Any, Any], compressor: str = "laguerre", **settings: Any
    ) -> None:
        _require(env, VECTOR, "single_observation_space")
        super().__init__(env)
        self._features = _ObservationFeatures(env, compressor, settings)
        self.map = self._features.map
        self.single_observation_space = self._features.space
        self.observation_space = batch_space(self._features.space, env.num_envs)
        self._shown: NDArray[np.float32] | None = None

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Reset and compress."""
        obs, info = self.env.reset(seed=seed, options=options)
        self._shown = self._features(obs)
        return self._shown.copy(), info

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Step and compress; an episode's last observation is the one it began with."""
        obs, reward, terminated, truncated, info = self.env.step(actions)
        assert self._shown is not None
        final = np.empty(self.num_envs, dtype=object)
        final[:] = list(self._shown)
        self._shown = self._features(obs)
        return self._shown.copy(), reward, terminated, truncated, {**info, "final_obs": final}


class LoopActionVector(VectorWrapper[Any, Any, Any, Any, Any]):
    """`LoopAction` for the native batch environment."""

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        _require(env, VECTOR, "single_action_space")
        super().__init__(env)
        self.map = ActionMap.of(sight(env.unwrapped).plant)
        self.single_action_space = _unit_box(self.map)
        self.action_space = batch_space(self.single_action_space, env.num_envs)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Map the actions to gains and step."""
        shape = (self.num_envs, *self.map.low.shape)
        given = validation.finite_array("action", actions, shape=shape)
        return self.env.step(self.map.gains(given))


def base_env(*, nonlinear: bool = False, **kwargs: Any) -> PITuningEnv:
    """The environment itself, or with `nonlinear` the one on saturating tyres."""
    return (PITuningNonlinearEnv if nonlinear else PITuningEnv)(**kwargs)


def features_env(compressor: str = "laguerre", **kwargs: Any) -> gymnasium.Env[Any, Any]:
    """Entry point of ``yawrate/PITuningFeatures-v0``; further arguments are `base_env`'s."""
    return LoopAction(Compressed(base_env(**kwargs), compressor))


def features_vector_env(
    num_envs: int = 1, compressor: str = "laguerre", *, nonlinear: bool = False, **kwargs: Any
) -> VectorEnv[Any, Any, Any]:
    """Build the batch form of `features_env`."""
    batch = (PITuningNonlinearVectorEnv if nonlinear else PITuningVectorEnv)(num_envs, **kwargs)
    return LoopActionVector(CompressedVector(batch, compressor))


def plant_features_env(plant: str | Plant, compressor: str = "laguerre") -> gymnasium.Env[Any, Any]:
    """Entry point of ``yawrate/PlantFeatures-v0``.

    Parameters
    ----------
    plant : str or Plant
        As for `yawrate_env.env.plant_env.PlantEnv`.
    compressor : str
        As for `Compressed`.
    """
    return LoopAction(Compressed(PlantEnv(plant), compressor))


def plant_features_vector_env(
    num_envs: int = 1, *, plant: str | Plant, compressor: str = "laguerre"
) -> VectorEnv[Any, Any, Any]:
    """Build the batch form of `plant_features_env`."""
    return LoopActionVector(CompressedVector(PlantVectorEnv(num_envs, plant=plant), compressor))


def _unit_box(actions: ActionMap) -> Box:
    return Box(-1.0, 1.0, actions.low.shape, dtype=np.float32)


def _require(env: Any, kinds: tuple[type, ...], space: str) -> None:
    """Refuse what is not the environment, and a `space` that is not the environment's own."""
    base = getattr(env, "unwrapped", env)
    form = "gymnasium.make" if kinds is SCALAR else "gymnasium.make_vec"
    remedy = f'Wrap what {form}("{ENV_ID}") or {form}("{PLANT_ID}", plant=...) gives.'
    if not isinstance(base, kinds):
        raise ValueError(f"{type(base).__name__} cannot be wrapped here. {remedy}")
    if getattr(env, space) != getattr(base, space):
        raise ValueError(f"Another wrapper has changed the {space} already. {remedy}")
