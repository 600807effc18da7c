"""Read and check data sets, never more than a shard at a time."""

import hashlib
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from tuners.data import shards
from tuners.data.columns import Columns
from tuners.data.manifest import DatasetError, Manifest, Shard
from tuners.tuner.examples import Examples
from yawrate_env import validation
from yawrate_env.batch import concatenate
from yawrate_env.plant.plant import Plant

Progress = Callable[[str, int, int], None]

_ROUNDING = 1e-6
"""Tolerance for the rounding of another processor, an iterative fit included."""


class Folder:
    """A finished data set.

    Parameters
    ----------
    path : path
        The folder that `generate` wrote.
    plant : Plant, optional
        The plant, if not to be imported from the entry that the manifest names, beside the
        folder or from the usual places: importing runs code.

    Attributes
    ----------
    recipe : Configuration
        Plant, set of episodes, features, seed and size.
    manifest : Manifest
        The same as it was written, and the shards.
    """

    def __init__(self, path: str | os.PathLike[str], plant: Plant | None = None) -> None:
        self.path = Path(path)
        self.manifest = Manifest.read(self.path)
        self.recipe = self.manifest.recipe(self.path.parent, plant)
        self.manifest.check_shards(self.path, self.recipe)
        missing = self.recipe.shard_count - len(self.manifest.shards)
        if missing:
            raise DatasetError(
                f"{self.path} lacks {missing} of its shards. Generate it again with the same "
                "settings: it goes on from there."
            )

    def __len__(self) -> int:
        return self.recipe.episodes

    def columns(self, names: Sequence[str] | None = None) -> Iterator[Columns]:
        """Some columns, or all but the recordings, in order and in bounded memory."""
        for shard in self.manifest.shards:
            yield from shards.read(self.path / shard.file, names)

    def batches(self) -> Iterator[Examples]:
        """Features, gains and parameters, in order and in bounded memory."""
        yield from (shards.examples(values, self.recipe) for values in self.columns())

    def row(self, episode: int, names: Sequence[str]) -> Columns:
        """One episode, every column with a first axis of 1."""
        shard = self.manifest.shards[episode // self.recipe.shard_size]
        for values in shards.read(self.path / shard.file, names):
            at = np.flatnonzero(values["episode"] == episode)
            if len(at):
                return {name: column[at] for name, column in values.items()}
        raise DatasetError(
            f"{self.path / shard.file} lacks episode {episode}. Verify the data set."
        )

    def read(self) -> Examples:
        """The whole data set, recordings left out."""
        return concatenate(list(self.batches()))


def damage(folder: Path, manifest: Manifest, progress: Progress | None = None) -> list[str]:
    """Read all shards that a manifest lists; say which of those that exist are damaged."""
    wrong = []
    for done, shard in enumerate(manifest.shards, start=1):
        path = folder / shard.file
        if path.is_dir():
            wrong.append(f"{path} is damaged: it is a folder")
        elif path.exists() and _sha256(path) != shard.sha256:
            wrong.append(f"{path} is damaged: its checksum is not the manifest's")
        if progress is not None:
            progress("verifying", done, len(manifest.shards))
    return wrong


def verify(
    out: str | os.PathLike[str],
    *,
    sample: int = 0,
    plant: Plant | None = None,
    progress: Progress | None = None,
) -> Folder:
    """Read every byte of a data set, and compare it with the manifest's checksums.

    Parameters
    ----------
    out : str or path
        The data set's folder.
    sample : int
        Also simulate so many episodes again, and compare the rows.
    plant : Plant, optional
        As for `Folder`.
    progress : callable, optional
        Called with the parts read and all parts.

    Raises
    ------
    DatasetError
        All that is missing or damaged, by name.
    """
    validation.count("sample", sample, at_least=0)
    found = Folder(out, plant)
    check(found, progress)
    if sample and not (worst := deviation(found, sample)) <= _ROUNDING:
        raise DatasetError(
            f"{out} is intact, but not what its seed gives here: columns differ by "
            f"{worst:.1e} of their largest value. Use the versions that its manifest names."
        )
    return found


def check(found: Folder, progress: Progress | None = None) -> None:
    """`DatasetError` with all that is missing or damaged, by name."""
    wrong = damage(found.path, found.manifest, progress)
    paths = [found.path / shard.file for shard in found.manifest.shards]
    wrong += [f"{path} is missing" for path in paths if not path.exists()]
    if wrong:
        raise DatasetError(
            f"{'; '.join(wrong)}. Delete what is damaged and generate again with the same "
            "settings: only that is made again."
        )


def deviation(found: Folder, sample: int) -> float:
    """Largest difference between rows and the same episodes simulated again.

    It is relative to the largest value of its column among them, and 0 on the kind of
    processor that made the data set.
    """
    episodes = np.unique(np.linspace(0, len(found) - 1, sample).astype(int)).tolist()
    fresh = [shards.columns(found.recipe, Shard("", episode, 1)) for episode in episodes]
    stored = [found.row(episode, list(fresh[0])) for episode in episodes]
    worst = 0.0
    for name in fresh[0]:
        a, b = (
            np.concatenate([row[name] for row in rows]).astype(np.float64)
            for rows in (fresh, stored)
        )
        if (np.isnan(a) != np.isnan(b)).any():
            return np.inf
        if not np.array_equal(a, b, equal_nan=True):
            worst = max(worst, float(np.nanmax(np.abs(a - b)) / np.nanmax(np.abs(a))))
    return worst


def _sha256(path: Path) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
