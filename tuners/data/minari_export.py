"""Episodes, actions and rewards for offline reinforcement learning, as a Minari data set.

Episode k shows the plant of row k of the same seed's data set, and follows behaviour
``k mod len(behaviours)``.  With actions in [-1, 1]^m (the plant's coordinates, see
`tuners.agents.feature_map.ActionMap`) and ``w`` uniform there:

| behaviour | action |
|---|---|
| `uniform` | w |
| `perturbed` | the oracle's + 0.1 w, clipped |
| `nominal` | that of the gains in the middle of the prior; 0 if there are none |
| `oracle` | that of the design rule, which knows the plant; if it has none, the nominal |
"""

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from tuners.agents.feature_map import ActionMap
from tuners.data.manifest import DatasetError
from tuners.data.minari_file import (
    REFERENCE_EPISODES,
    References,
    check_behaviours,
    check_new,
    written,
)
from yawrate_env import ENV_ID, FEATURES_ID, PLANT_FEATURES_ID, PLANT_ID, validation
from yawrate_env.plant.entry import find, named
from yawrate_env.plant.episodes import SETS, Episodes, integers_of, parameters, ranges_of
from yawrate_env.plant.episodes import episodes as episodes_of
from yawrate_env.plant.fingerprint import changed, fingerprint
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.streams import stream

if TYPE_CHECKING:
    from minari import MinariDataset
    from minari.data_collector import EpisodeBuffer

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

BEHAVIOURS = ("uniform", "perturbed", "nominal", "oracle")
LARGEST = 100_000

RAW = ENV_ID, PLANT_ID
"""Environments on recordings; the others are on features."""

_PERTURBATION = 0.1


def export_minari(
    dataset_id: str,
    episodes: int,
    seed: int = 0,
    *,
    set: str = "train",
    plant: Plant | str | None = None,
    raw: bool = False,
    behaviours: Sequence[str] = BEHAVIOURS,
    env_kwargs: dict[str, Any] | None = None,
    progress: Progress | None = None,
) -> "MinariDataset":
    """Write one-step episodes of the environment where Minari keeps its data sets.

    Parameters
    ----------
    dataset_id : str
        Minari's name of it, such as ``"yawrate/mixture-v0"``.
    episodes : int
        At most 100 000: Minari keeps a group of arrays an episode.
    seed : int
        Of the episodes, as in `generate`, and of random actions.
    set : str
        Which set of episodes, of `yawrate_env.plant.episodes.SETS`.
    plant : Plant or str, optional
        One with an entry, or ``"module:attribute"``, instead of the default vehicles.
    raw : bool
        Recordings and gains of ``yawrate/PITuning-v0``, 160 kB an episode, or of
        ``yawrate/Plant-v0``, instead of the features and actions of
        ``yawrate/PITuningFeatures-v0`` or ``yawrate/PlantFeatures-v0``.
    behaviours : sequence of str
        Behaviours in turn, of `BEHAVIOURS`.
    env_kwargs : dict, optional
        Further arguments of the environment.
    progress : callable, optional
        Called with the stage's name, how many episodes are done, and of how many.

    Raises
    ------
    DatasetError
        There is one of that name already.
    """
    remedy = "Use tuners.data.generate for more."
    validation.number("episodes", episodes, at_most=LARGEST, remedy=remedy)
    episodes = validation.count("episodes", episodes)
    seed = validation.count("seed", seed, at_least=0)
    validation.flag("raw", raw)
    validation.one_of("set of episodes", set, tuple(SETS))
    validation.instance("env_kwargs", env_kwargs or {}, dict, remedy="Give names with values.")
    check_behaviours(behaviours, BEHAVIOURS)
    check_new(dataset_id)
    env = _environment(plant, raw, env_kwargs or {})
    ranges_of(env.unwrapped.plant, set)
    description = (
        f"One-step episodes of seed {seed}, set {set}; behaviours in turn: "
        f"{', '.join(behaviours)}. An episode's options pin its plant."
    )
    references = _references(env, seed, set)
    buffers = _buffers(env, episodes, seed, set, behaviours, progress)
    return written(dataset_id, env, behaviours, description, references, buffers)


def _environment(plant: Plant | str | None, raw: bool, kwargs: dict[str, Any]) -> Any:
    """The environment that the data set records; of a plant as it is found again."""
    if plant is None:
        return gymnasium.make(ENV_ID if raw else FEATURES_ID, **kwargs)
    described = find(plant)
    entry = named(described, "A data set")
    if described.arguments:
        raise ValueError(
            f"plant = {entry} takes arguments, which Minari cannot store. Give a plant that is "
            "an attribute of its module."
        )
    if other := changed(find(entry), fingerprint(described)):
        raise DatasetError(
            f"plant is not the {entry} that is found again: its {other} differs. Give it an entry "
            "of its own."
        )
    return gymnasium.make(PLANT_ID if raw else PLANT_FEATURES_ID, plant=entry, **kwargs)


def _references(env: Any, seed: int, set: str) -> References:
    """Mean rewards of random actions and of the design rule, on the set's first plants."""
    interface, space = env.unwrapped.interface, env.action_space
    plant, known = interface.plant, ActionMap.of(interface.plant)
    drawn = stream((SETS[set], seed), 0, REFERENCE_EPISODES, integers_of(plant))
    theta = parameters(plant, drawn[:, : len(plant.prior)], ranges_of(plant, set))
    share = np.random.default_rng((SETS[set], seed, 1)).random((len(theta), *space.shape))
    actions = space.low + (space.high - space.low) * share
    random = actions if env.spec.id in RAW else known.gains(actions)
    oracle = plant.oracle(theta)
    oracle = np.where(np.isnan(oracle), plant.oracle(plant.middle), oracle)
    low, high = (float(interface.outcome(theta, gains)[0].mean()) for gains in (random, oracle))
    return References(low, high)


def _buffers(
    env: Any,
    episodes: int,
    seed: int,
    set: str,
    behaviours: Sequence[str],
    progress: Progress | None,
) -> "Iterator[EpisodeBuffer]":
    """Episodes one after the other, simulated a block at a time."""
    from minari.data_collector import EpisodeBuffer

    plant = env.unwrapped.plant
    actions = ActionMap.of(plant)
    shape = episodes, len(actions.low)
    noise = np.random.default_rng((SETS[set], seed)).uniform(-1, 1, shape)
    turns = np.resize(np.array(behaviours), episodes)
    for block in episodes_of(plant, set, seed, 0, episodes):
        steps = _steps(env, block, actions, turns[block.number], noise[block.number])
        for k, obs, action, reward, theta in zip(block.number, *steps, block.theta, strict=True):
            yield EpisodeBuffer(
                id=int(k),
                options=dict(zip(plant.prior, theta.tolist(), strict=True)),
                observations=np.stack([obs, obs]),  # the environment shows the same again
                actions=action[None],
                rewards=[reward],
                terminations=[True],
                truncations=[False],
            )
        if progress is not None:
            progress("exporting", int(block.number[-1]) + 1, episodes)


def _steps(
    env: Any, block: Episodes, known: ActionMap, turns: NDArray[np.str_], noise: Array
) -> tuple[NDArray[np.float32], NDArray[Any], Array]:
    """Observations, actions and rewards of B episodes, as the environment has them."""
    interface = env.unwrapped.interface
    plant = interface.plant
    nominal, oracle = (
        known.actions(plant.oracle(plant.middle)),
        known.actions(plant.oracle(block.theta)),
    )
    nominal = np.nan_to_num(nominal).repeat(len(block), axis=0)
    oracle = np.where(np.isnan(oracle), nominal, oracle)
    actions = np.select(
        [(turns == name)[:, None] for name in BEHAVIOURS],
        [noise, np.clip(oracle + _PERTURBATION * noise, -1, 1), nominal, oracle],
    ).astype(np.float32)
    gains = known.gains(actions)
    rewards, _ = interface.outcome(block.theta, gains)
    observations = interface.observe(block.u, block.y, block.theta)
    if env.spec.id in RAW:
        return observations, gains, rewards
    features = [env.get_wrapper_attr("observation")(obs) for obs in observations]
    return np.stack(features), actions, rewards
