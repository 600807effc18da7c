"""The native batch environment behind ``gymnasium.make_vec("yawrate/PITuning-v0")``."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from yawrate_env import batch, interaction, validation
from yawrate_env.env import Observation, PITuningEnv
from yawrate_env.episode import WORDS, Draw

Array = NDArray[Any]

_SEED = "Give an integer that is not negative."


class PITuningVectorEnv(VectorEnv[Observation, NDArray[np.float64], Array]):
    """`num_envs` environments in one batch of simulations, reset in the same step.

    Sub-environment i has a random generator of its own and repeats, bit for bit, what
    a scalar environment seeded like it does.  Keyword arguments are those of
    `PITuningEnv`.
    """

    scalar: ClassVar[type[PITuningEnv]] = PITuningEnv
    """What a sub-environment is."""

    metadata: dict[str, Any] = {
        "autoreset_mode": AutoresetMode.SAME_STEP,
        "render_modes": ["rgb_array"],
        "render_fps": 1,
    }

    def __init__(self, num_envs: int = 1, *, render_mode: str | None = None, **kwargs: Any) -> None:
        self.num_envs = validation.count(
            "num_envs", num_envs, at_most=1e6, remedy="Use more batches."
        )
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode = {render_mode!r}: a batch renders to 'rgb_array' only.")
        one = self.scalar(**kwargs)
        self.task, self.visible, self.decimate = one.task, one.visible, one.decimate
        self.single_observation_space = one.observation_space
        self.single_action_space = one.action_space
        self.observation_space = batch_space(one.observation_space, self.num_envs)
        self.action_space = batch_space(one.action_space, self.num_envs)
        self.render_mode = render_mode
        self._generators: list[np.random.Generator] | None = None
        self._seeds: list[int] = []
        self._drawn: Draw | None = None
        self._obs: Observation | None = None

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """Every sub-environment's generator."""
        self._ensure_generators()
        assert self._generators is not None
        return tuple(self._generators)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """Every sub-environment's seed."""
        self._ensure_generators()
        return tuple(self._seeds)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observation, dict[str, Any]]:
        """Reset all, or those in ``options["reset_mask"]``."""
        given = interaction.mapping(options)
        mask = self._reset_mask(given.pop("reset_mask", None))
        fixed = interaction.pinned(given, self.num_envs)
        self._seed(seed, mask)
        self._renew(mask, fixed)
        assert self._obs is not None
        return self._obs.copy(), {}

    def step(
        self, actions: NDArray[np.float64]
    ) -> tuple[Observation, Array, Array, Array, dict[str, Any]]:
        """Judge every sub-environment's gains and start its next episode."""
        if self._drawn is None or self._obs is None:
            raise ResetNeeded("Call reset() before the first step().")
        checked = interaction.checked_actions(actions, self.num_envs)
        verdict, info = interaction.outcome(self.task, self._drawn.context, checked)
        everyone = np.ones(self.num_envs, dtype=np.bool_)
        final_obs = np.empty(self.num_envs, dtype=object)
        final_obs[:] = list(self._obs)
        final_info: dict[str, Any] = {}
        for name, values in info.items():
            final_info[name], final_info[f"_{name}"] = values, everyone.copy()
        self._renew(everyone, {})
        return (
            self._obs.copy(),
            verdict.reward,
            everyone.copy(),
            ~everyone,
            {
                "final_obs": final_obs,
                "_final_obs": everyone.copy(),
                "final_info": final_info,
                "_final_info": everyone.copy(),
            },
        )

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One frame a sub-environment, of the episode that waits for gains."""
        if self.render_mode is None:
            gymnasium.logger.warn(
                'No render_mode was given: gym.make_vec(..., render_mode="rgb_array").'
            )
            return None
        if self._drawn is None or self._obs is None:
            raise ResetNeeded("There is nothing to draw yet. Call reset() before render().")
        from yawrate_env.rendering import figure, pixels

        return tuple(
            pixels(figure(self.task, batch.take(self._drawn.context, slice(i, i + 1)), obs, None))
            for i, obs in enumerate(self._obs)
        )

    def _renew(self, mask: Array, fixed: dict[str, NDArray[np.float64]]) -> None:
        """Draw and record new episodes where `mask` is true."""
        assert self._generators is not None
        chosen = np.flatnonzero(mask)
        words = np.stack([self._generators[i].bit_generator.random_raw(WORDS) for i in chosen])
        part = {name: values[chosen] for name, values in fixed.items()}
        drawn = interaction.draw(words, self.task, part)
        obs = interaction.observe(self.task, drawn, self.visible, self.decimate)
        if self._drawn is None or self._obs is None or mask.all():
            self._drawn, self._obs = drawn, obs
            return
        self._obs = self._obs.copy()
        self._obs[chosen] = obs
        self._drawn = batch.replaced(self._drawn, chosen, drawn)

    def _reset_mask(self, mask: Any) -> Array:
        if mask is None:
            return np.ones(self.num_envs, dtype=np.bool_)
        array = np.asarray(mask)
        if array.shape != (self.num_envs,) or array.dtype != np.bool_ or not array.any():
            raise ValueError(
                f"options['reset_mask'] must be a boolean array of shape ({self.num_envs},) "
                "with a true value in it."
            )
        if self._drawn is None:
            raise ResetNeeded("The first reset() must reset every sub-environment.")
        return array

    def _seed(self, seed: int | Sequence[int | None] | None, mask: Array) -> None:
        self._ensure_generators()
        assert self._generators is not None
        if seed is None:
            return
        for i, one in enumerate(_seeds(seed, self.num_envs)):
            if mask[i] and one is not None:
                self._generators[i], self._seeds[i] = seeding.np_random(one)

    def _ensure_generators(self) -> None:
        if self._generators is None:
            pairs = [seeding.np_random() for _ in range(self.num_envs)]
            self._generators = [generator for generator, _ in pairs]
            self._seeds = [seed for _, seed in pairs]


def _seeds(seed: Any, count: int) -> list[int | None]:
    """One seed or None for each of `count` sub-environments, all checked."""
    if isinstance(seed, str | bytes | Mapping):
        raise ValueError(f"seed = {seed!r} is not a number. Give an integer, or one each.")
    if not isinstance(seed, Iterable):
        first = validation.count("seed", seed, at_least=0, remedy=_SEED)
        return [first + i for i in range(count)]
    seeds = [
        None if one is None else validation.count(f"seed[{i}]", one, at_least=0, remedy=_SEED)
        for i, one in enumerate(seed)
    ]
    if len(seeds) != count:
        raise ValueError(f"{len(seeds)} seeds for {count} sub-environments.")
    return seeds
