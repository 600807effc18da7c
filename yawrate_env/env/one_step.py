"""One-step environments in one batch: seeds, partial resets, and the next episode at once."""

from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Generic, TypeVar

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from yawrate_env import batch, validation
from yawrate_env.env import interaction

Array = NDArray[Any]
Observation = NDArray[np.float32]
Drawn = TypeVar("Drawn")

_SEED = "Give an integer that is not negative."


class OneStepVectorEnv(VectorEnv[Observation, NDArray[np.float64], Array], Generic[Drawn]):
    """`num_envs` environments whose episodes are one step, reset in the same step.

    Sub-environment i has a random generator of its own and repeats what a scalar
    environment seeded like it does.  A subclass says what an episode is: a record
    `Drawn` of arrays over the batch.

    Parameters
    ----------
    num_envs : int
        How many.
    single_observation_space, single_action_space : Space
        Of one.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}

    words: int
    """64-bit random words an episode."""

    def __init__(
        self, num_envs: int, single_observation_space: Any, single_action_space: Any
    ) -> None:
        self.num_envs = validation.count(
            "num_envs", num_envs, at_most=1e6, remedy="Use more batches."
        )
        self.single_observation_space = single_observation_space
        self.single_action_space: Any = single_action_space
        self.observation_space = batch_space(single_observation_space, self.num_envs)
        self.action_space = batch_space(single_action_space, self.num_envs)
        self._generators: list[np.random.Generator] | None = None
        self._seeds: list[int] = []
        self._drawn: Drawn | None = None
        self._obs: Observation | None = None

    @abstractmethod
    def pinned(self, options: Mapping[str, Any]) -> dict[str, NDArray[np.float64]]:
        """Values (num_envs,) that the options of ``reset`` pin, checked."""

    @abstractmethod
    def begin(
        self, words: NDArray[np.uint64], fixed: Mapping[str, NDArray[np.float64]]
    ) -> tuple[Drawn, Observation]:
        """Episodes from random words (B, `words`), and what is seen of them."""

    @abstractmethod
    def judge(self, drawn: Drawn, actions: Any) -> tuple[NDArray[np.float64], dict[str, Array]]:
        """Rewards (num_envs,) and information in arrays over the batch."""

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """Every sub-environment's generator."""
        return tuple(self._own_generators())

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """Every sub-environment's seed."""
        self._own_generators()
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
        fixed = self.pinned(given)
        self._seed(seed, mask)
        self._renew(mask, fixed)
        assert self._obs is not None
        return self._obs.copy(), {}

    def step(
        self, actions: NDArray[np.float64]
    ) -> tuple[Observation, Array, Array, Array, dict[str, Any]]:
        """Loops every sub-environment's gains and start its next episode."""
        if self._drawn is None or self._obs is None:
            raise ResetNeeded("Call reset() before the first step().")
        reward, info = self.judge(self._drawn, actions)
        everyone = np.ones(self.num_envs, dtype=np.bool_)
        final_obs = np.empty(self.num_envs, dtype=object)
        final_obs[:] = list(self._obs)
        final_info: dict[str, Any] = {}
        for name, values in info.items():
            final_info[name], final_info[f"_{name}"] = values, everyone.copy()
        self._renew(everyone, {})
        return (
            self._obs.copy(),
            reward,
            everyone.copy(),
            ~everyone,
            {
                "final_obs": final_obs,
                "_final_obs": everyone.copy(),
                "final_info": final_info,
                "_final_info": everyone.copy(),
            },
        )

    def _renew(self, mask: Array, fixed: Mapping[str, NDArray[np.float64]]) -> None:
        """Draw and record new episodes where `mask` is true."""
        generators, chosen = self._own_generators(), np.flatnonzero(mask)
        words = np.stack([generators[i].bit_generator.random_raw(self.words) for i in chosen])
        drawn, obs = self.begin(words, {name: values[chosen] for name, values in fixed.items()})
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
        generators = self._own_generators()
        if seed is None:
            return
        for i, one in enumerate(_seeds(seed, self.num_envs)):
            if mask[i] and one is not None:
                generators[i], self._seeds[i] = seeding.np_random(one)

    def _own_generators(self) -> list[np.random.Generator]:
        if self._generators is None:
            pairs = [seeding.np_random() for _ in range(self.num_envs)]
            self._generators = [generator for generator, _ in pairs]
            self._seeds = [seed for _, seed in pairs]
        return self._generators


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
