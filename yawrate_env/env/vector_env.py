"""One-step environments in one batch: seeds, partial resets, and the next episode at once."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.env.buffers import Buffers
from yawrate_env.env.interface import Array, Interface, Observation, copied
from yawrate_env.plant.entry import find
from yawrate_env.plant.plant import Plant

Flags = NDArray[np.bool_]

_SEED = "Give an integer that is not negative."


class TuningVectorEnv(VectorEnv[Observation, Array, NDArray[Any]]):
    """`num_envs` of `TuningEnv` in one batch of simulations, reset in the same step.

    Sub-environment i has a random generator of its own and repeats, bit for bit, what a
    scalar environment seeded like it does.  Only what is random inside a simulator comes from
    the first sub-environment's generator.

    Observations are the caller's to keep: the memory that they lie in is written again only after
    the last array that shows it is gone, so that a loop needs no fresh memory.

    Parameters
    ----------
    num_envs : int
        How many.
    interface : Interface
        Between the plant and the agents.
    autoreset_mode : AutoresetMode or str
        When the next episode begins: ``"SameStep"``, ``"NextStep"`` (every second step of an
        episode of one step is then a reset, and its action is ignored), or ``"Disabled"``: by
        ``reset(options={"reset_mask": ...})``.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}

    def __init__(
        self,
        num_envs: int,
        interface: Interface,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
    ) -> None:
        self.num_envs = validation.count(
            "num_envs", num_envs, at_most=1e6, remedy="Use more batches."
        )
        self.interface = interface
        self.autoreset_mode = mode_of(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self._over = np.zeros(self.num_envs, dtype=np.bool_)
        self.single_observation_space: Any = interface.observation_space
        self.single_action_space: Any = interface.action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._generators: list[np.random.Generator] | None = None
        self._seeds: list[int] = []
        self._theta: Array | None = None
        self._obs: Observation | None = None
        self._buffers = Buffers((self.num_envs, *interface.observation_space.shape), np.float32)

    @property
    def plant(self) -> Plant:
        """The family of plants that episodes are drawn from."""
        return self.interface.plant

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
        given = copied(options)
        mask = self._reset_mask(given.pop("reset_mask", None))
        pins = self.interface.pins(given, self.num_envs)
        self._seed(seed, mask)
        self._over = self._over & ~mask
        return self._renew(mask, pins), {}

    def step(self, actions: Array) -> tuple[Observation, Array, Flags, Flags, dict[str, Any]]:
        """Evaluate every sub-environment's gains and start its next episode."""
        if self._theta is None or self._obs is None:
            raise ResetNeeded("Call reset() before the first step().")
        shape = (self.num_envs, len(self.plant.gains))
        given = validation.finite_array("action", actions, shape=shape)
        if self.autoreset_mode is not AutoresetMode.SAME_STEP:
            return self._step_until_over(given)
        reward, info = self.interface.outcome(self._theta, given)
        everyone = np.ones(self.num_envs, dtype=np.bool_)
        final_obs = np.empty(self.num_envs, dtype=object)
        final_obs[:] = list(self._obs)
        final_info: dict[str, Any] = {}
        for name, values in info.items():
            final_info[name], final_info[f"_{name}"] = values, everyone.copy()
        return (
            self._renew(everyone, {}),
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

    def _step_until_over(
        self, given: Array
    ) -> tuple[Observation, Array, Flags, Flags, dict[str, Any]]:
        """Evaluate episodes that are open, and reset those that the last step ended."""
        assert self._theta is not None and self._obs is not None
        over = self._over
        if over.any() and self.autoreset_mode is AutoresetMode.DISABLED:
            raise ResetNeeded('Call reset(options={"reset_mask": ...}) for episodes that ended.')
        acting, reward, found = ~over, np.zeros(self.num_envs), {}
        if acting.any():
            values, info = self.interface.outcome(self._theta[acting], given[acting])
            reward[acting] = values
            for name, column in info.items():
                found[name] = np.zeros(self.num_envs, dtype=column.dtype)
                found[name][acting], found[f"_{name}"] = column, acting.copy()
        obs = self._renew(over, {}) if over.any() else self._obs.copy()
        self._over = acting
        return obs, reward, acting.copy(), np.zeros_like(acting), found

    def _renew(self, mask: Flags, pins: Mapping[str, Array]) -> Observation:
        """Draw and record new episodes where `mask` is true; what the caller gets of all."""
        generators, chosen = self._own_generators(), np.flatnonzero(mask)
        count = self.interface.integers
        integers = np.stack([generators[i].bit_generator.random_raw(count) for i in chosen])
        pinned = {name: values[chosen] for name, values in pins.items()}
        obs, shown = self._buffers.empty(), self._buffers.empty()
        if self._theta is None or self._obs is None or mask.all():
            self._theta = self.interface.begin(integers, pinned, generators[0], obs, shown)
        else:
            part = np.empty((len(chosen), *obs.shape[1:]), dtype=np.float32)
            theta = self._theta.copy()
            theta[chosen] = self.interface.begin(integers, pinned, generators[0], part)
            obs[:], obs[chosen], self._theta = self._obs, part, theta
            shown[...] = obs
        self._obs = obs
        return shown

    def _reset_mask(self, mask: Any) -> Flags:
        if mask is None:
            return np.ones(self.num_envs, dtype=np.bool_)
        array = np.asarray(mask)
        if array.shape != (self.num_envs,) or array.dtype != np.bool_ or not array.any():
            raise ValueError(
                f"options['reset_mask'] must be a boolean array of shape ({self.num_envs},) "
                "with a true value in it."
            )
        if self._theta is None:
            raise ResetNeeded("The first reset() must reset every sub-environment.")
        return array

    def _seed(self, seed: int | Sequence[int | None] | None, mask: Flags) -> None:
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


def plant_vector_env(
    num_envs: int = 1,
    *,
    plant: str | Plant,
    autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
) -> TuningVectorEnv:
    """Entry point of ``yawrate/Plant-v0`` as a batch; `plant` as for the scalar one."""
    return TuningVectorEnv(num_envs, Interface.of(find(plant)), autoreset_mode)


def mode_of(value: Any) -> AutoresetMode:
    """The mode, or that with this value."""
    if isinstance(value, AutoresetMode):
        return value
    modes = tuple(str(mode.value) for mode in AutoresetMode)
    return AutoresetMode(validation.one_of("autoreset_mode", value, modes))


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
        raise ValueError(f"{len(seeds)} seeds for {count} sub-environments. Give one each.")
    return seeds
