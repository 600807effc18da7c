"""``yawrate/Plant-v0``: any described plant as a one-step Gymnasium environment."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from tuners.learners.actor import stretched
from yawrate_env import validation
from yawrate_env.env import interaction
from yawrate_env.env.one_step import Observation, OneStepVectorEnv
from yawrate_env.plant.action_bounds import action_bounds, corners
from yawrate_env.plant.entry import find
from yawrate_env.plant.episodes import Draw, designed, integers_of
from yawrate_env.plant.names import ORACLE
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

_LARGEST = 1e30  # finite, as agents want it, and beyond any unit


class PlantEnv(gymnasium.Env[Observation, Array]):
    """See one recorded experiment on an unknown plant; answer with its controller's gains.

    | space | shape | content |
    |---|---|---|
    | observation | (2 + m, N) float32 | input, measured output; m parameters measured, constant |
    | action | (k,) float64 | gains; what the prior's plants need, and a quarter more |

    The reward is -e/(1 + e/4) with e the distance of the plant's figures from what the
    design rule reaches, in the errors that count as one; -4 where a figure is undefined,
    -5 where the loop is unstable.  An episode is one step.  The info after it has the
    gains, ``clipped``, ``stable``, the figures, ``oracle_NAME`` of every gain and the
    parameters; that of ``reset`` is empty.

    Parameters
    ----------
    plant : str or Plant
        ``"module:attribute"``; a Plant itself works too, but not with ``EnvSpec.to_json``.
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(self, plant: str | Plant) -> None:
        self.plant = find(plant)
        self.observation_space: Any = observation_space(self.plant)
        self.action_space: Any = action_space(self.plant)
        self._theta: Array | None = None
        self._obs: Observation | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Draw a plant and record the experiment; `options` pin parameters by name."""
        super().reset(seed=seed)
        words = self.np_random.bit_generator.random_raw(integers_of(self.plant))[None]
        fixed = pinned(self.plant, interaction.mapping(options), 1)
        self._theta, obs = begun(self.plant, words, fixed, self.np_random)
        self._obs = obs[0]
        return self._obs.copy(), {}

    def step(self, action: Array) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Loops the gains."""
        if self._theta is None or self._obs is None:
            raise ResetNeeded("An episode has one step. Call reset() before the next step().")
        given = validation.finite_array("action", action, shape=(len(self.plant.gains),))
        reward, info = outcome(self.plant, self.action_space, self._theta, given[None])
        self._theta = None
        scalar = {name: values[0].item() for name, values in info.items()}
        return self._obs.copy(), float(reward[0]), True, False, scalar


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """The plants (B, p) of episodes that wait for gains."""

    theta: Array


class PlantVectorEnv(OneStepVectorEnv[Drawn]):
    """`num_envs` of `PlantEnv` in one batch of simulations, reset in the same step.

    What is random inside the simulator itself comes from the first sub-environment's
    generator; all else is each one's own.
    """

    def __init__(self, num_envs: int = 1, *, plant: str | Plant) -> None:
        self.plant = find(plant)
        self.words = integers_of(self.plant)
        super().__init__(num_envs, observation_space(self.plant), action_space(self.plant))

    def pinned(self, options: Mapping[str, Any]) -> dict[str, Array]:
        """Parameters (num_envs,) by name."""
        return pinned(self.plant, options, self.num_envs)

    def begin(
        self, words: NDArray[np.uint64], fixed: Mapping[str, Array]
    ) -> tuple[Drawn, Observation]:
        """Draw and record."""
        theta, obs = begun(self.plant, words, fixed, self.np_random[0])
        return Drawn(theta), obs

    def judge(self, drawn: Drawn, actions: Any) -> tuple[Array, dict[str, NDArray[Any]]]:
        """Figures, rewards and the truth."""
        shape = (self.num_envs, len(self.plant.gains))
        given = validation.finite_array("action", actions, shape=shape)
        return outcome(self.plant, self.single_action_space, drawn.theta, given)


def pinned(plant: Plant, options: Mapping[str, Any], count: int) -> dict[str, Array]:
    """Parameters that the options of ``reset`` pin, (count,) each."""
    values: dict[str, Array] = {}
    for name, value in options.items():
        validation.one_of("options' parameter", name, tuple(plant.prior))
        array = np.atleast_1d(validation.real_array(name, value)).astype(np.float64)
        for one in array:
            plant.check_value(name, one)
        if len(array) not in (1, count):
            raise ValueError(f"options' {name} has {len(array)} values: give one, or {count}.")
        values[name] = np.broadcast_to(array, (count,))
    return values


def begun(
    plant: Plant, words: NDArray[np.uint64], fixed: Mapping[str, Array], rng: np.random.Generator
) -> tuple[Array, Observation]:
    """Parameters (B, p) and observations (B, 2 + m, N) of recorded experiments."""
    draw = Draw.of(plant, words)
    for i, values in zip(plant.indices(fixed), fixed.values(), strict=True):
        draw.theta[:, i] = values
    y = plant.measure(draw.theta, draw.u, draw.keys, rng)
    return draw.theta, observation(plant, draw.u, y, draw.theta)


def outcome(
    plant: Plant, space: Box, theta: Array, actions: Array
) -> tuple[Array, dict[str, NDArray[Any]]]:
    """Rewards (B,) of actions (B, k), and all that there is to know, arrays (B,)."""
    gains = np.clip(actions, space.low, space.high)
    figures, oracle = plant.metric_values(theta, gains), plant.oracle(theta)
    info = {
        **dict(zip(plant.gains, gains.T, strict=True)),
        "clipped": (gains != actions).any(axis=1),
        "stable": ~np.isnan(figures).any(axis=1),
        **dict(zip(plant.metrics, figures.T, strict=True)),
        **{ORACLE + name: values for name, values in zip(plant.gains, oracle.T, strict=True)},
        **dict(zip(plant.prior, theta.T, strict=True)),
    }
    return plant.reward_of(figures - plant.targets(theta)), info


def observation_space(plant: Plant) -> Box:
    """Rows: input, measured output, and what is measured beside them."""
    shape = (2 + len(plant.measured_names), len(plant.u))
    return Box(-_LARGEST, _LARGEST, shape, dtype=np.float32)


def observation(plant: Plant, u: Array, y: Array, theta: Array) -> Observation:
    """(B, 2 + m, N) of recordings (1 or B, N), (B, N) and parameters (B, p)."""
    beside = theta[:, plant.indices(plant.measured_names)].T
    rows = [u, y, *(values[:, None] for values in beside)]
    return np.stack([np.broadcast_to(row, y.shape) for row in rows], axis=1).astype(np.float32)


def recordings(plant: Plant, obs: ArrayLike) -> tuple[Array, Array, Array, bool]:
    """Inputs (1 or B, N), outputs (B, N), parameters (B, p) of observations, and whether of one.

    Parameters that are not shown are those in the middle of the prior.
    """
    array = np.asarray(obs, dtype=np.float64)
    batch, names = array if array.ndim == 3 else array[None], plant.measured_names
    shape = (2 + len(names), len(plant.u))
    if batch.ndim != 3 or batch.shape[1:] != shape:
        raise ValueError(
            f"obs has shape {array.shape}, wanted {shape} or a batch of these, as "
            "yawrate/Plant-v0 gives them for this plant."
        )
    theta = np.tile(plant.middle, (len(batch), 1))
    theta[:, plant.indices(names)] = batch[:, 2:, 0]
    u = batch[:, 0]
    return u[:1] if (u == u[:1]).all() else u, batch[:, 1], theta, array.ndim == 2


def action_space(plant: Plant) -> Box:
    """Gains that coordinates within reach stand for."""
    low, high = action_bounds(plant)
    units = corners(-np.ones_like(low), np.ones_like(low))
    ends = plant.parametrisation.decode(stretched(units, low, high))
    gains = np.concatenate([designed(plant), ends[np.isfinite(ends).all(axis=1)]])
    return Box(gains.min(axis=0), gains.max(axis=0), dtype=np.float64)
