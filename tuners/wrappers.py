"""Wrappers that make `yawrate/PITuning-v0` ready to train on, scalar and vector.

`Compressed` shows standardised features instead of the recording; `LoopAction` takes
actions in [-1, 1] and maps them to loop coordinates.  The vector forms do the same to
a batch, final observations included.  ``yawrate/PITuningFeatures-v0`` has both.
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from tuners.compressors import compressor
from tuners.feature_map import LIMIT, ActionMap, FeatureMap
from tuners.recording import Recording
from yawrate_env.env import PITuningEnv
from yawrate_env.interaction import VISIBLE, checked_actions
from yawrate_env.nonlinear.env import PITuningNonlinearEnv, PITuningNonlinearVectorEnv
from yawrate_env.vector_env import PITuningVectorEnv


class _ObservationFeatures:
    """What both observation wrappers do."""

    def __init__(self, env: Any, name: str, settings: dict[str, Any]) -> None:
        base = env.unwrapped
        self.Ts = base.task.experiment.Ts * base.decimate
        self.map = FeatureMap.of(
            base.task, compressor(name, **settings), VISIBLE[base.visible], base.decimate
        )
        n = len(self.map.mean)
        self.space = Box(-LIMIT, LIMIT, (n,), dtype=np.float32)

    def __call__(self, obs: NDArray[np.float32]) -> NDArray[np.float32]:
        recording, single = Recording.of_observations(obs, self.Ts)
        features, _ = self.map(recording)
        return features[0] if single else features


class Compressed(gymnasium.ObservationWrapper, gymnasium.utils.RecordConstructorArgs):
    """Show standardised features of the recording.

    Parameters
    ----------
    env : gymnasium.Env
        ``yawrate/PITuning-v0``.
    compressor : {"laguerre", "armax"}
        First stage.
    **settings
        The compressor's own, such as ``order=8``.
    """

    def __init__(
        self, env: gymnasium.Env[Any, Any], compressor: str = "laguerre", **settings: Any
    ) -> None:
        _require(env, PITuningEnv, "observation_space")
        gymnasium.utils.RecordConstructorArgs.__init__(self, compressor=compressor, **settings)
        gymnasium.ObservationWrapper.__init__(self, env)
        self._features = _ObservationFeatures(env, compressor, settings)
        self.observation_space = self._features.space

    def observation(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Compress one recording."""
        return self._features(observation)


class LoopAction(gymnasium.ActionWrapper, gymnasium.utils.RecordConstructorArgs):
    """Take actions in [-1, 1], the controller's log magnitude and phase at the crossover."""

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        _require(env, PITuningEnv, "action_space")
        gymnasium.utils.RecordConstructorArgs.__init__(self)
        gymnasium.ActionWrapper.__init__(self, env)
        self.map = ActionMap.of(_task(env))
        self.action_space = _unit_box()

    def action(self, action: NDArray[np.float32]) -> NDArray[np.float64]:
        """One action to (kp, Ti)."""
        return np.asarray(self.map.gains(checked_actions(np.asarray(action)[None], 1))[0])


class CompressedVector(VectorWrapper[Any, Any, Any, Any, Any]):
    """`Compressed` for the native batch environment."""

    def __init__(
        self, env: VectorEnv[Any, Any, Any], compressor: str = "laguerre", **settings: Any
    ) -> None:
        _require(env, PITuningVectorEnv, "single_observation_space")
        super().__init__(env)
        self._features = _ObservationFeatures(env, compressor, settings)
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
        _require(env, PITuningVectorEnv, "single_action_space")
        super().__init__(env)
        self.map = ActionMap.of(_task(env))
        self.single_action_space = _unit_box()
        self.action_space = batch_space(self.single_action_space, env.num_envs)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Map the actions to gains and step."""
        return self.env.step(self.map.gains(checked_actions(actions, self.num_envs)))


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


def _unit_box() -> Box:
    return Box(-1.0, 1.0, (2,), dtype=np.float32)


def _require(env: Any, kind: type, space: str) -> None:
    """Refuse what is not the environment, and a `space` that is not the environment's own."""
    base = getattr(env, "unwrapped", env)
    form = "gymnasium.make" if kind is PITuningEnv else "gymnasium.make_vec"
    remedy = f'Wrap what {form}("yawrate/PITuning-v0") gives.'
    if not isinstance(base, kind):
        raise ValueError(f"{type(base).__name__} cannot be wrapped here. {remedy}")
    if getattr(env, space) != getattr(base, space):
        raise ValueError(f"Another wrapper has changed the {space} already. {remedy}")


def _task(env: Any) -> Any:
    return env.unwrapped.task
