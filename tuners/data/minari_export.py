"""Episodes, actions and rewards for offline reinforcement learning, as a Minari data set.

Episode k shows the vehicle of row k of the same seed's data set, and follows behaviour
``k mod len(behaviours)``.  With ``a`` an action in [-1, 1]^2 (loop coordinates, see
`tuners.feature_map.ActionMap`) and ``w`` uniform there:

| behaviour | action |
|---|---|
| `uniform` | w |
| `perturbed` | the oracle's + 0.1 w, clipped |
| `nominal` | that of the mid-prior vehicle's gains |
| `oracle` | that of the design rule, which knows the vehicle |
"""

import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from tuners.baselines import Nominal, Oracle
from tuners.data.manifest import DatasetError
from tuners.feature_map import ActionMap
from tuners.recording import Recording
from yawrate_env import ENV_ID, FEATURES_ID, interaction, validation
from yawrate_env.contexts import CONTEXT_SETS, ContextSet
from yawrate_env.episode import Draw
from yawrate_env.vehicle import Context

if TYPE_CHECKING:
    from minari import MinariDataset
    from minari.data_collector import EpisodeBuffer

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

BEHAVIOURS = ("uniform", "perturbed", "nominal", "oracle")
LARGEST = 100_000

_PERTURBATION = 0.1
_CHUNK = 256


def export_minari(
    dataset_id: str,
    episodes: int,
    seed: int = 0,
    *,
    contexts: ContextSet = CONTEXT_SETS["train"],
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
    raw : bool
        Recordings and gains of ``yawrate/PITuning-v0``, 160 kB an episode, instead of
        the features and actions of ``yawrate/PITuningFeatures-v0``.
    behaviours : sequence of str
        Who acts in turn, of `BEHAVIOURS`.
    env_kwargs : dict, optional
        Arguments of the environment.

    Raises
    ------
    DatasetError
        There is one of that name already.
    """
    import minari

    remedy = "Use tuners.data.generate for more."
    validation.number("episodes", episodes, at_most=LARGEST, remedy=remedy)
    episodes = validation.count("episodes", episodes)
    seed = validation.count("seed", seed, at_least=0)
    validation.count("number of behaviours", len(behaviours))
    for name in behaviours:
        validation.one_of("behaviour", name, BEHAVIOURS)
    if dataset_id in minari.list_local_datasets():
        raise DatasetError(f"Minari has {dataset_id} already. Delete it, or choose another name.")
    env = gymnasium.make(ENV_ID if raw else FEATURES_ID, **env_kwargs or {})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of an address and a link that are not given
        empty = minari.create_dataset_from_buffers(
            dataset_id,
            [],
            env=env,
            eval_env=env,
            algorithm_name=", ".join(behaviours),
            author="yawrate",
            description=(
                f"One-step episodes of seed {seed}, context set {contexts.name}; behaviours "
                f"in turn: {', '.join(behaviours)}. An episode's options pin its vehicle."
            ),
        )
    try:
        _indexed(empty.storage.data_path)
        empty.storage.update_episodes(_buffers(env, episodes, seed, contexts, behaviours, progress))
    except BaseException:
        minari.delete_dataset(dataset_id)
        raise
    return minari.load_dataset(dataset_id)


def _indexed(folder: Path) -> None:
    """Make Minari's file again, with a root group that knows how many episodes it has.

    Minari counts them before each one that it adds.  In the file that it makes the count
    walks over all of them, and the export takes a time quadratic in their number.
    """
    import h5py

    (path,) = folder.glob("*.hdf5")
    with h5py.File(path, "w", track_order=True):
        pass


def _buffers(
    env: Any,
    episodes: int,
    seed: int,
    contexts: ContextSet,
    behaviours: Sequence[str],
    progress: Progress | None,
) -> "Iterator[EpisodeBuffer]":
    """Episodes one after the other, simulated a chunk at a time."""
    from minari.data_collector import EpisodeBuffer

    noise = np.random.default_rng((contexts.tag, seed)).uniform(-1, 1, (episodes, 2))
    turns = np.resize(np.array(behaviours), episodes)
    for first in range(0, episodes, _CHUNK):
        chunk = slice(first, min(first + _CHUNK, episodes))
        drawn = contexts.draw(env.unwrapped.task.prior, seed, first, chunk.stop - first)
        steps = zip(*_steps(env, drawn, turns[chunk], noise[chunk]), strict=True)
        for k, (obs, action, reward) in enumerate(steps):
            vehicle = {name: float(getattr(drawn.context, name)[k]) for name in Context.__slots__}
            yield EpisodeBuffer(
                id=first + k,
                options=vehicle,
                observations=np.stack([obs, obs]),  # the environment shows the same again
                actions=action[None],
                rewards=[reward],
                terminations=[True],
                truncations=[False],
            )
        if progress is not None:
            progress("exporting", chunk.stop, episodes)


def _steps(
    env: Any, drawn: Draw, turns: NDArray[np.str_], noise: Array
) -> tuple[NDArray[np.float32], NDArray[Any], Array]:
    """Observations, actions and rewards of B episodes, as the environment has them."""
    base = env.unwrapped
    task, coordinates = base.task, ActionMap.of(base.task)
    obs = interaction.observe(task, drawn, base.visible, base.decimate)
    shown, _ = Recording.of_observations(obs, task.experiment.Ts * base.decimate)
    oracle = coordinates.actions(Oracle(task).act(replace(shown, context=drawn.context)))
    actions = np.select(
        [(turns == name)[:, None] for name in BEHAVIOURS],
        [
            noise,
            np.clip(oracle + _PERTURBATION * noise, -1, 1),
            coordinates.actions(Nominal(task).act(shown)),
            oracle,
        ],
    ).astype(np.float32)
    gains = coordinates.gains(actions)
    rewards = interaction.outcome(task, drawn.context, gains)[0].reward
    if env.spec.id == ENV_ID:
        return obs, gains, rewards
    return env.get_wrapper_attr("observation")(obs), actions, rewards
