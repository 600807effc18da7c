"""Agents that learn from recorded episodes alone, as Minari keeps them.

| agent | learns from |
|---|---|
| `naf-offline` | a mixture of random, disturbed, nominal and best actions, with rewards |
| `naf-offline-uniform` | random actions alone, with rewards |
| `bc-offline` | the mixture's actions: behaviour cloning, as in Minari's tutorial |
"""

import time
from collections.abc import Callable, Iterator
from typing import Any

import minari
import numpy as np
from numpy.typing import NDArray

from studies.comparison import Score, score, test
from tuners.agents.actors import actor_of
from tuners.agents.feature_map import ActionMap
from tuners.agents.naf import NAF
from tuners.agents.wrappers import FeatureObservation, base_env
from tuners.data.minari_export import BEHAVIOURS, export_minari
from tuners.learners.actor import Actor, Agent
from tuners.learners.threads import threads
from tuners.tuner.stages import Stages
from tuners.tuner.tuner import Tuner
from yawrate_env.plant.reward import error_of
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

Array = NDArray[Any]
Progress = Callable[[str, int, int], None]

SETS = {"mixture": BEHAVIOURS, "uniform": ("uniform",)}
AGENTS = {
    "naf-offline": ("mixture", "naf"),
    "naf-offline-uniform": ("uniform", "naf"),
    "bc-offline": ("mixture", "bc"),
}
_WIDTH, _EPOCHS, _ROWS, _RATE = 64, 30, 128, 1e-3


def dataset(name: str, episodes: int, progress: Progress) -> Any:
    """One of `SETS`, exported or found again."""
    identity = f"yawrate/{name}{episodes}-v0"
    if identity in minari.list_local_datasets():
        return minari.load_dataset(identity)
    return export_minari(identity, episodes, behaviours=SETS[name], progress=progress)


def columns(data: Any) -> tuple[Array, Array, Array]:
    """Observations (N, n), actions (N, m) and rewards (N,) of one-step episodes."""
    rows = [(e.observations[0], e.actions[0], e.rewards[0]) for e in data.iterate_episodes()]
    observations, actions, rewards = (np.stack(column) for column in zip(*rows, strict=True))
    return observations, actions, rewards


def learned(kind: str, env: Any, seen: tuple[Array, Array, Array], seed: int) -> Actor:
    """An actor from standardised features to actions in [-1, 1]."""
    observations, actions, rewards = seen
    if kind == "bc":
        return cloned(observations, actions, seed)
    model = NAF("MlpPolicy", env, error=error_of, seed=seed)
    return actor_of(model.learn_offline(observations, actions, rewards), {})


def cloned(observations: Array, actions: Array, seed: int) -> Actor:
    """The actions' mean at an observation, by two layers and squared error."""
    import torch

    torch.manual_seed(seed)
    x, a = (torch.from_numpy(part).float() for part in (observations, actions))
    n, m = x.shape[1], a.shape[1]
    linear = [torch.nn.Linear(*shape) for shape in ((n, _WIDTH), (_WIDTH, _WIDTH), (_WIDTH, m))]
    network = torch.nn.Sequential(linear[0], torch.nn.ReLU(), linear[1], torch.nn.ReLU(), linear[2])
    optimiser = torch.optim.Adam(network.parameters(), _RATE)
    for _ in range(_EPOCHS):
        for rows in torch.split(torch.randperm(len(x)), _ROWS):
            loss = (network(x[rows]) - a[rows]).square().mean()
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
    layers = [
        (layer.weight.detach().double().numpy(), layer.bias.detach().double().numpy())
        for layer in linear
    ]
    return Actor(layers, "relu", squashed=False)


def scores(episodes: int, seeds: int, progress: Progress) -> Iterator[Score]:
    """Every agent with every seed, on the test episodes of `studies.comparison`."""
    plant = yaw_rate(Task())
    chosen, observed = ActionMap.of(plant), FeatureObservation(base_env()).map
    for name, (which, kind) in AGENTS.items():
        data = dataset(which, episodes, progress)
        env, seen = data.recover_environment(), columns(data)
        for seed in range(seeds):
            began = time.perf_counter()
            with threads(1):
                actor = learned(kind, env, seen, seed)
            seconds = time.perf_counter() - began
            agent = Agent(actor, observed.mean, observed.scale, chosen.low, chosen.high)
            tuner = Tuner(plant, Stages(observed.features, agent), {"name": name})
            (found,) = test({name: tuner}, plant)
            yield score(found, episodes, seed, seconds)
            progress(name, seed + 1, seeds)
