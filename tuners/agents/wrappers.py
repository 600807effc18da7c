"""Wrappers that make the environments of `yawrate_env` ready to train on.

`FeatureObservation` gives standardised features instead of the recording; `UnitAction` takes
actions in [-1, 1] and maps them to the plant's coordinates and on to gains.  The vector forms
do the same to a batch, final observations included.  ``yawrate/PITuningFeatures-v0`` and
``yawrate/PlantFeatures-v0`` have both.
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from tuners.agents.feature_map import ActionMap, FeatureMap
from tuners.features import Features, features_named
from tuners.learners.actor import LIMIT
from tuners.tuner.recipes import features_by_name
from yawrate_env import ENV_ID, PLANT_ID, validation
from yawrate_env.env.interface import Interface
from yawrate_env.env.tuning_env import TuningEnv, plant_env
from yawrate_env.env.vector_env import TuningVectorEnv, plant_vector_env
from yawrate_env.env.yaw_rate_env import (
    PITuningEnv,
    PITuningNonlinearEnv,
    PITuningNonlinearVectorEnv,
    PITuningVectorEnv,
)
from yawrate_env.plant.plant import Plant


class FeatureObservation(gymnasium.ObservationWrapper, gymnasium.utils.RecordConstructorArgs):
    """Observe standardised features of the recording.

    Parameters
    ----------
    env : gymnasium.Env
        ``yawrate/PITuning-v0`` or ``yawrate/Plant-v0``.
    features : {"laguerre", "armax", "response"}
        First stage; a plant's Laguerre functions are those of its default recipe.
    **settings
        The first stage's own, such as ``order=8``.
    """

    def __init__(
        self, env: gymnasium.Env[Any, Any], features: str = "laguerre", **settings: Any
    ) -> None:
        self._interface = _interface(env, TuningEnv, "observation_space")
        gymnasium.utils.RecordConstructorArgs.__init__(self, features=features, **settings)
        gymnasium.ObservationWrapper.__init__(self, env)
        self.map = _feature_map(self._interface, features, settings)
        self.observation_space = _feature_box(self.map)
        self._features: NDArray[np.float32] | None = None

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Reset; features of the recording."""
        obs, info = self.env.reset(seed=seed, options=options)
        self._features = self.observation(obs)
        return self._features.copy(), info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step; the episode's only recording has the features that it had."""
        _, reward, terminated, truncated, info = self.env.step(action)
        assert self._features is not None
        return self._features.copy(), reward, terminated, truncated, info

    def observation(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Features of one recording."""
        return np.asarray(features_of(self._interface, self.map, observation[None])[0])


class UnitAction(gymnasium.ActionWrapper, gymnasium.utils.RecordConstructorArgs):
    """Take actions in [-1, 1]: the coordinates of a plant's controller.

    A vehicle's are the log magnitude and the phase at the crossover.
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        interface = _interface(env, TuningEnv, "action_space")
        gymnasium.utils.RecordConstructorArgs.__init__(self)
        gymnasium.ActionWrapper.__init__(self, env)
        self.map = ActionMap.of(interface.plant)
        self.action_space = _unit_box(self.map)

    def action(self, action: NDArray[np.float32]) -> NDArray[np.float64]:
        """One action to gains."""
        given = validation.finite_array("action", action, shape=self.map.low.shape)
        return np.asarray(self.map.gains(given[None])[0])


class _BatchWrapper(VectorWrapper[Any, Any, Any, Any, Any]):
    """A wrapper that resets as what it wraps does."""

    @property
    def autoreset_mode(self) -> AutoresetMode:
        """When the next episode begins."""
        mode: AutoresetMode = self.env.metadata["autoreset_mode"]
        return mode


class FeatureVectorObservation(_BatchWrapper):
    """`FeatureObservation` for the native batch environment."""

    def __init__(
        self, env: VectorEnv[Any, Any, Any], features: str = "laguerre", **settings: Any
    ) -> None:
        self._interface = _interface(env, TuningVectorEnv, "single_observation_space")
        super().__init__(env)
        self.map = _feature_map(self._interface, features, settings)
        self.single_observation_space = _feature_box(self.map)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)
        self._features: NDArray[np.float32] | None = None

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Reset; features of the recordings."""
        obs, info = self.env.reset(seed=seed, options=options)
        self._features = features_of(self._interface, self.map, obs)
        return self._features.copy(), info

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Step; an episode's last observation is the one it began with."""
        obs, reward, terminated, truncated, info = self.env.step(actions)
        assert self._features is not None
        if self.autoreset_mode is not AutoresetMode.SAME_STEP:
            fresh = ~terminated  # an episode that goes on has just begun
            if fresh.any():
                self._features = self._features.copy()
                self._features[fresh] = features_of(self._interface, self.map, obs[fresh])
            return self._features.copy(), reward, terminated, truncated, info
        final = np.empty(self.num_envs, dtype=object)
        final[:] = list(self._features)
        self._features = features_of(self._interface, self.map, obs)
        return self._features.copy(), reward, terminated, truncated, {**info, "final_obs": final}


class UnitVectorAction(_BatchWrapper):
    """`UnitAction` for the native batch environment."""

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        interface = _interface(env, TuningVectorEnv, "single_action_space")
        super().__init__(env)
        self.map = ActionMap.of(interface.plant)
        self.single_action_space = _unit_box(self.map)
        self.action_space = batch_space(self.single_action_space, env.num_envs)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Map the actions to gains and step."""
        shape = (self.num_envs, *self.map.low.shape)
        given = validation.finite_array("action", actions, shape=shape)
        return self.env.step(self.map.gains(given))


def base_env(*, nonlinear: bool = False, **kwargs: Any) -> PITuningEnv:
    """The vehicle's environment, or with `nonlinear` the one on saturating tyres."""
    kind = PITuningNonlinearEnv if validation.flag("nonlinear", nonlinear) else PITuningEnv
    return kind(**kwargs)


def features_env(features: str = "laguerre", **kwargs: Any) -> gymnasium.Env[Any, Any]:
    """Entry point of ``yawrate/PITuningFeatures-v0``; further arguments are `base_env`'s."""
    return UnitAction(FeatureObservation(base_env(**kwargs), features))


def features_vector_env(
    num_envs: int = 1, features: str = "laguerre", *, nonlinear: bool = False, **kwargs: Any
) -> VectorEnv[Any, Any, Any]:
    """Build the batch form of `features_env`."""
    curved = validation.flag("nonlinear", nonlinear)
    kind = PITuningNonlinearVectorEnv if curved else PITuningVectorEnv
    return UnitVectorAction(FeatureVectorObservation(kind(num_envs, **kwargs), features))


def plant_features_env(plant: str | Plant, features: str = "laguerre") -> gymnasium.Env[Any, Any]:
    """Entry point of ``yawrate/PlantFeatures-v0``.

    Parameters
    ----------
    plant : str or Plant
        As for `yawrate_env.env.tuning_env.plant_env`.
    features : str
        As for `FeatureObservation`.
    """
    return UnitAction(FeatureObservation(plant_env(plant), features))


def plant_features_vector_env(
    num_envs: int = 1,
    *,
    plant: str | Plant,
    features: str = "laguerre",
    autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
) -> VectorEnv[Any, Any, Any]:
    """Build the batch form of `plant_features_env`."""
    batch = plant_vector_env(num_envs, plant=plant, autoreset_mode=autoreset_mode)
    return UnitVectorAction(FeatureVectorObservation(batch, features))


def _interface(env: Any, kind: type[TuningEnv | TuningVectorEnv], space: str) -> Interface:
    """That of an environment whose `space` no other wrapper has changed."""
    base = getattr(env, "unwrapped", env)
    form = "gymnasium.make" if kind is TuningEnv else "gymnasium.make_vec"
    remedy = f'Wrap what {form}("{ENV_ID}") or {form}("{PLANT_ID}", plant=...) gives.'
    if not isinstance(base, kind):
        raise ValueError(f"env = {type(base).__name__} cannot be wrapped here. {remedy}")
    if getattr(env, space) != getattr(base, space):
        raise ValueError(f"env: another wrapper has changed the {space} already. {remedy}")
    return base.interface


def _feature_map(interface: Interface, name: str, settings: dict[str, Any]) -> FeatureMap:
    first_stage = _first_stage(interface, name, settings)
    return FeatureMap.of(interface.plant, first_stage, interface.features_of, interface.decimate)


def _first_stage(interface: Interface, name: str, settings: dict[str, Any]) -> Features:
    if name == "laguerre" and interface.basis is not None:
        order, pole = interface.basis
        return features_named(name, **{"order": order, "pole": pole} | settings)
    return features_by_name(interface.plant, name, **settings)


def features_of(
    interface: Interface, features: FeatureMap, obs: NDArray[Any]
) -> NDArray[np.float32]:
    """Standardised features (B, n) of observations (B, rows, N)."""
    u, y, theta = interface.recordings(obs)
    values, _ = features(u, y, interface.Ts, interface.features_of(theta))
    return values


def _feature_box(features: FeatureMap) -> Box:
    return Box(-LIMIT, LIMIT, features.mean.shape, dtype=np.float32)


def _unit_box(actions: ActionMap) -> Box:
    return Box(-1.0, 1.0, actions.low.shape, dtype=np.float32)
