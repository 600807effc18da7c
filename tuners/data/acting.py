"""Episodes to act in, of vehicles or of any plant: what is shown, known and earned in each.

Episode k shows the plant of row k of the same seed's data set.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.tuner.baselines import Nominal, Oracle
from tuners.tuner.recording import Recording
from yawrate_env.env import interaction
from yawrate_env.env.plant_env import PlantEnv, observation, outcome
from yawrate_env.env.yaw_rate_env import PITuningEnv
from yawrate_env.plant.episodes import episodes
from yawrate_env.vehicle.contexts import ContextSet
from yawrate_env.vehicle.single_track import Context

Array = NDArray[np.float64]
Rewards = Callable[[Array], Array]


@dataclass(frozen=True, slots=True, eq=False)
class Acts:
    """B episodes that wait for gains.

    Attributes
    ----------
    observations : NDArray
        (B, rows, N) float32 of the environment on recordings.
    truth : dict
        Options of ``reset`` that pin the plants, (B,) each.
    oracle, nominal : NDArray
        (B, k) gains of the design rule that knows the plants, and of the one in the
        middle of the prior; ``nan`` where there are none.
    rewards : callable
        Gains (B, k) to rewards (B,).
    """

    observations: NDArray[np.float32]
    truth: dict[str, Array]
    oracle: Array
    nominal: Array
    rewards: Rewards


def acts(env: Any, contexts: ContextSet, seed: int, count: int, chunk: int) -> Iterator[Acts]:
    """Episodes of an environment's vehicles or plants, some at a time.

    Parameters
    ----------
    env : gymnasium.Env
        One of the four environments, bare or on features.
    contexts : ContextSet
        Which family of episodes.
    seed : int
        Of the data set whose first `count` rows they are.
    chunk : int
        Vehicles at a time; plants come in blocks of their own.
    """
    base = env.unwrapped
    if isinstance(base, PlantEnv):
        yield from _of_plants(base, contexts, seed, count)
        return
    for first in range(0, count, chunk):
        yield _of_vehicles(base, contexts, seed, first, min(chunk, count - first))


def _of_plants(env: PlantEnv, contexts: ContextSet, seed: int, count: int) -> Iterator[Acts]:
    plant = env.plant
    for block in episodes(plant, contexts.name, seed, 0, count):
        theta = block.theta

        def rewards(gains: Array, theta: Array = theta) -> Array:
            return outcome(plant, env.action_space, theta, gains)[0]

        yield Acts(
            observation(plant, block.u, block.y, theta),
            dict(zip(plant.prior, theta.T, strict=True)),
            plant.oracle(theta),
            plant.oracle(plant.middle).repeat(len(theta), axis=0),
            rewards,
        )


def _of_vehicles(env: PITuningEnv, contexts: ContextSet, seed: int, first: int, count: int) -> Acts:
    task = env.task
    drawn = contexts.draw(task.prior, seed, first, count)
    obs = interaction.observe(task, drawn, env.visible, env.decimate)
    shown, _ = Recording.of_observations(obs, task.experiment.Ts * env.decimate)
    return Acts(
        obs,
        {name: getattr(drawn.context, name) for name in Context.__slots__},
        Oracle(task).act(replace(shown, context=drawn.context)),
        Nominal(task).act(shown),
        lambda gains: interaction.outcome(task, drawn.context, gains)[0].reward,
    )
