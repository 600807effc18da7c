"""The native batch environment behind ``gymnasium.make_vec("yawrate/PITuning-v0")``."""

from collections.abc import Mapping
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from yawrate_env import batch
from yawrate_env.env import interaction
from yawrate_env.env.one_step import Array, OneStepVectorEnv
from yawrate_env.env.yaw_rate_env import Observation, PITuningEnv
from yawrate_env.vehicle.episode import WORDS, Draw


class PITuningVectorEnv(OneStepVectorEnv[Draw]):
    """`num_envs` environments in one batch of simulations, reset in the same step.

    Sub-environment i has a random generator of its own and repeats, bit for bit, what
    a scalar environment seeded like it does.  Keyword arguments are those of
    `PITuningEnv`.
    """

    scalar: ClassVar[type[PITuningEnv]] = PITuningEnv
    """What a sub-environment is."""

    metadata: dict[str, Any] = {
        **OneStepVectorEnv.metadata,
        "render_modes": ["rgb_array"],
        "render_fps": 1,
    }
    words = WORDS

    def __init__(self, num_envs: int = 1, *, render_mode: str | None = None, **kwargs: Any) -> None:
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode = {render_mode!r}: a batch renders to 'rgb_array' only.")
        one = self.scalar(**kwargs)
        super().__init__(num_envs, one.observation_space, one.action_space)
        self.task, self.visible, self.decimate = one.task, one.visible, one.decimate
        self.render_mode = render_mode

    def pinned(self, options: Mapping[str, Any]) -> dict[str, NDArray[np.float64]]:
        """Context values (num_envs,) by name."""
        return interaction.pinned(options, self.num_envs)

    def begin(
        self, words: NDArray[np.uint64], fixed: Mapping[str, NDArray[np.float64]]
    ) -> tuple[Draw, Observation]:
        """Draw and record."""
        drawn = interaction.draw(words, self.task, fixed)
        return drawn, interaction.observe(self.task, drawn, self.visible, self.decimate)

    def judge(self, drawn: Draw, actions: Any) -> tuple[NDArray[np.float64], dict[str, Array]]:
        """Margins, rewards and the truth."""
        checked = interaction.checked_actions(actions, self.num_envs)
        verdict, info = interaction.outcome(self.task, drawn.context, checked)
        return verdict.reward, info

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One frame a sub-environment, of the episode that waits for gains."""
        if self.render_mode is None:
            gymnasium.logger.warn(
                'No render_mode was given: gym.make_vec(..., render_mode="rgb_array").'
            )
            return None
        if self._drawn is None or self._obs is None:
            raise ResetNeeded("There is nothing to draw yet. Call reset() before render().")
        from yawrate_env.env.rendering import figure, pixels

        return tuple(
            pixels(figure(self.task, batch.take(self._drawn.context, slice(i, i + 1)), obs, None))
            for i, obs in enumerate(self._obs)
        )
