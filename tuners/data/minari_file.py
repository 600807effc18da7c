"""A new data set where Minari keeps them: its name, its metadata, and its episodes one by one."""

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tuners.data.manifest import DatasetError
from yawrate_env import validation

if TYPE_CHECKING:
    from minari import MinariDataset
    from minari.data_collector import EpisodeBuffer

REFERENCE_EPISODES = 1000
"""Of which reference scores are means."""


@dataclass(frozen=True, slots=True)
class References:
    """What `minari.get_normalized_score` calls 0 and 1.

    Attributes
    ----------
    random, expert : float
        Mean returns of actions that are uniform in the environment's box, and of the design rule
        that knows the plant.
    episodes : int
        Of which they are means.
    """

    random: float
    expert: float
    episodes: int = REFERENCE_EPISODES


def check_new(dataset_id: Any) -> None:
    """Refuse a name that is taken, and one after which Minari could list no data set any more."""
    import minari
    from minari.dataset.minari_dataset import parse_dataset_id

    try:
        parse_dataset_id(dataset_id)
    except (ValueError, TypeError):
        raise ValueError(
            f"dataset_id = {dataset_id!r} is no name of Minari's. Give letters, digits, dashes and "
            'a version, as in "yawrate/mixture-v0".'
        ) from None
    if dataset_id in minari.list_local_datasets():
        raise DatasetError(f"Minari has {dataset_id} already. Delete it, or choose another name.")


def check_behaviours(behaviours: Any, known: tuple[str, ...]) -> None:
    """``ValueError`` unless `behaviours` is a list or tuple of known ones."""
    if not isinstance(behaviours, list | tuple) or not behaviours:
        raise ValueError(f"behaviours = {behaviours!r} must be some of {', '.join(known)}.")
    for name in behaviours:
        validation.one_of("behaviour", name, known)


def written(
    dataset_id: str,
    env: Any,
    behaviours: Sequence[str],
    description: str,
    references: References,
    episodes: "Iterable[EpisodeBuffer]",
) -> "MinariDataset":
    """Write a data set; nothing is left of one that fails."""
    import minari

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of an address and a link that are not given
        empty = minari.create_dataset_from_buffers(
            dataset_id,
            [],
            env=env,
            eval_env=env,
            algorithm_name=", ".join(behaviours),
            author="yawrate",
            description=description,
            ref_min_score=references.random,
            ref_max_score=references.expert,
            num_episodes_average_score=references.episodes,
        )
    try:
        _indexed(empty.storage.data_path)
        empty.storage.update_episodes(episodes)
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
