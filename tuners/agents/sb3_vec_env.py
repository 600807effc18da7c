"""The native batch environment as Stable-Baselines3's `VecEnv`.

The two libraries' batch interfaces differ in names and in where an episode's last
observation goes; nothing else happens here.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, VectorEnv
from stable_baselines3.common.vec_env import VecEnv


class Sb3VecEnv(VecEnv):
    """Adapter from a `gymnasium.vector.VectorEnv` that resets in the same step.

    Parameters
    ----------
    env : VectorEnv
        Such as ``gymnasium.make_vec("yawrate/PITuningFeatures-v0", num_envs=16)``.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        if env.metadata.get("autoreset_mode") is not AutoresetMode.SAME_STEP:
            raise ValueError(
                "The vector environment must reset in the same step. "
                "Use the native one: gymnasium.make_vec(...) without a vectorization_mode."
            )
        self.env = env
        self._actions: Any = None
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> Any:
        """Reset all, with the seeds and options set before."""
        seeds: Any = self._seeds if any(s is not None for s in self._seeds) else None
        obs, _ = self.env.reset(seed=seeds, options=self._common_options())
        self._reset_seeds()
        self._reset_options()
        return obs

    def step_async(self, actions: np.ndarray[Any, Any]) -> None:
        """Keep the actions."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, Any, Any, list[dict[str, Any]]]:
        """Step; infos of episodes that end are the final ones, with `terminal_observation`."""
        obs, rewards, terminated, truncated, info = self.env.step(self._actions)
        ended = terminated | truncated
        infos = []
        for i in range(self.num_envs):
            told: dict[str, Any] = info["final_info"] if ended[i] else info
            shown = {name: values[i].item() for name, values in told.items()
                     if not name.startswith(("_", "final_"))}  # fmt: skip
            if ended[i]:
                shown["terminal_observation"] = info["final_obs"][i]
            shown["TimeLimit.truncated"] = bool(truncated[i] and not terminated[i])
            infos.append(shown)
        return obs, rewards.astype(np.float32), ended, infos

    def close(self) -> None:
        """Close the vector environment."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Attribute of the batch, once for every index."""
        return [getattr(self.env, attr_name)] * len(self._indices(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse: sub-environments have no attributes of their own."""
        raise NotImplementedError("Give keyword arguments to gymnasium.make_vec instead.")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> Any:
        """Refuse: sub-environments have no methods of their own."""
        raise NotImplementedError("A batch environment has no sub-environments to call.")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Never, in the sense of scalar wrappers."""
        return [False] * len(self._indices(indices))

    def _common_options(self) -> dict[str, Any] | None:
        first, *others = self._options
        if not all(data_equivalence(one, first) for one in others):
            raise ValueError(
                "set_options got different options for the sub-environments. Give one "
                "dictionary; its values may be arrays with a number for each."
            )
        return first or None

    def _indices(self, indices: Any) -> Sequence[int]:
        return list(self._get_indices(indices))
