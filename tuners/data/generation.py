"""Data sets of any size: shards made in parallel, written one by one, resumed where they stopped.

One that grows is one that is not finished: its manifest says more, and the rest is made.

Workers only compute; this process alone writes.  So a cluster needs no common file
system, a full disk is met in one place, and nothing that a worker does when it is killed
can be seen in the folder.
"""

import errno
import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from filelock import FileLock, Timeout

from tuners.data import manifest, shards
from tuners.data.folder import Folder, damage
from tuners.data.manifest import Configuration, DatasetError, Manifest, Shard
from tuners.features import Features, with_measured
from tuners.workers import WorkersError, results
from yawrate_env import validation
from yawrate_env.compiled import cores
from yawrate_env.files import leftovers, replacing
from yawrate_env.plant import entry
from yawrate_env.plant.plant import Plant

Progress = Callable[[str, int, int], None]

_LOCK = ".lock"  # in the folder while it is written, and after a process was killed
_REMEDIES = {
    errno.ENOSPC: "Free some space",
    errno.EDQUOT: "Free some space",
    errno.EFBIG: "Choose smaller shards",
    errno.EACCES: "Choose a folder that you may write to",
    errno.EPERM: "Choose a folder that you may write to",
    errno.EROFS: "Choose a folder that you may write to",
}


def generate(
    plant: Plant,
    set: str,
    features: Features,
    episodes: int,
    seed: int,
    out: str | os.PathLike[str],
    *,
    shard_size: int | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    raw: bool = False,
    resume: bool = True,
    progress: Progress | None = None,
) -> Folder:
    """Write the first `episodes` of a seed to a folder.

    The bytes do not depend on the workers, nor on how often the run was interrupted or asked
    for more; rows do not depend on `shard_size` either.

    Parameters
    ----------
    plant : Plant
        Workers and readers find it again by its `entry`.
    set : str
        Which set of episodes: train, test, extrapolation or calibration.
    features : Armax, Laguerre, Regularised or FrequencyResponse
        First stage.
    episodes : int
        How many; a folder that holds fewer grows, one that holds more is refused.
    out : path
        A new folder, or one of the same configuration, finished or not.
    shard_size : int, optional
        Episodes a file; 4096, more from four million episodes on, or 512 with recordings.
    workers : int, optional
        Processes; all cores.
    scheduler : str, optional
        Address of a Dask scheduler, or ``"local"`` for a cluster of `workers` processes.
    raw : bool
        Keep the recordings too, 8 bytes a sample before compression.
    resume : bool
        Go on in a folder that exists; otherwise refuse it.
    progress : callable, optional
        Called with the stage's name, how many episodes are done, and of how many.

    Raises
    ------
    DatasetError
        The folder cannot be written or resumed.  What was finished stays; a start that
        finished nothing leaves nothing.
    """
    count = cores() if workers is None else validation.count("workers", workers)
    episodes = validation.count("episodes", episodes)
    validation.instance("plant", plant, Plant, remedy="Give a Plant.")
    if shard_size is None:
        shard_size = manifest.shard_size(episodes, raw)
    recipe = Configuration(plant, set, features, seed, episodes, shard_size, raw)
    _check_features(recipe)
    folder = Path(out)
    place = entry.home(plant) or folder.parent
    found_again = Configuration.from_json(recipe.to_json(), place)  # as all workers will
    home = entry.home(found_again.plant)
    with _owned(folder):
        with _explained(folder):
            found = _begun(folder, recipe, resume, progress)
        listed = {shard.file for shard in found.shards}
        missing = [shard for shard in recipe.shards() if shard.file not in listed]
        done = episodes - sum(shard.rows for shard in missing)
        if progress is not None:
            progress("simulating", done, episodes)
        work = partial(shards.made, found.configuration, home=home)
        for shard, content in _made(work, missing, count, scheduler):
            with _explained(folder):
                found = _with(found, shard, content, folder)
            done += shard.rows
            if progress is not None:
                progress("simulating", done, episodes)
    return Folder(folder, plant)


def _made(
    work: Callable[[Shard], bytes], missing: list[Shard], count: int, scheduler: str | None
) -> Iterator[tuple[Shard, bytes]]:
    """Shards and their bytes; a worker's failure is that of the data set."""
    try:
        yield from results(work, missing, count, scheduler)
    except WorkersError as error:
        raise DatasetError(f"{error} A shard is a job.") from None


def _check_features(recipe: Configuration) -> None:
    """``ValueError`` where the first stage cannot work on recordings of that length."""
    plant = recipe.plant
    y = plant.respond(plant.middle)
    with np.errstate(all="ignore"):
        with_measured(recipe.features, plant.u[None], y, plant.Ts, np.empty((1, 0)))


def _begun(
    folder: Path, recipe: Configuration, resume: bool, progress: Progress | None
) -> Manifest:
    """The manifest to continue from, once nothing in the folder is half-written or damaged."""
    for name in (manifest.FILE, "shard-*.parquet"):
        for stale in leftovers(folder / name):
            stale.unlink()
    configuration = recipe.to_json()
    if not _names(folder):
        begun = Manifest(configuration)
        begun.write(folder)  # before any work: can it be written at all?
        return begun
    if not (folder / manifest.FILE).exists():
        raise DatasetError(f"{folder} holds something else already. Name a new folder.")
    if not resume:
        raise DatasetError(f"{folder} holds a data set already. Resume it, or name a new folder.")
    before = Manifest.read(folder)
    found = before.grown(recipe.episodes)
    if other := recipe.differences(found.configuration):
        raise DatasetError(
            f"{folder} holds another data set: {other}. Name a new folder, or use its settings."
        )
    found.check_shards(folder, recipe)
    _check_own(folder, recipe)
    wrong = damage(folder, found, progress)
    if wrong:
        raise DatasetError(f"{'; '.join(wrong)}. Delete what is damaged: it will be made again.")
    if found is not before:
        found.write(folder)  # before a longer shard takes the place of a shorter one
    return replace(found, shards=tuple(s for s in found.shards if (folder / s.file).exists()))


def _check_own(folder: Path, recipe: Configuration) -> None:
    """Refuse a folder with files of others, links or folders in it."""
    own = {manifest.FILE, _LOCK, *(shard.file for shard in recipe.shards())}
    for path in sorted(folder.iterdir()):
        if path.name not in own or path.is_symlink() or not path.is_file():
            what = "a link" if path.is_symlink() else "a folder" if path.is_dir() else "foreign"
            raise DatasetError(f"{path} is {what}. Move it away, or name a new folder.")


def _with(found: Manifest, shard: Shard, content: bytes, folder: Path) -> Manifest:
    """Write a shard, and then that it is there."""
    with replacing(folder / shard.file) as file:
        file.write(content)
    found = found.with_shard(replace(shard, sha256=hashlib.sha256(content).hexdigest()))
    found.write(folder)
    return found


@contextmanager
def _owned(folder: Path) -> Iterator[None]:
    """Make the folder and lock it; the lock ends with the process, however that ends."""
    with _explained(folder):
        if folder.exists() and not folder.is_dir():
            raise DatasetError(f"{folder} is a file. Name a folder.")
        made = [place for place in (folder, *folder.parents) if not place.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        empty = not _names(folder)
        lock = FileLock(folder / _LOCK, blocking=False)
        try:
            lock.acquire()
        except Timeout:
            raise DatasetError(
                f"{folder} is being written by another process. Wait for it."
            ) from None
        except NotImplementedError:
            pass  # a network file system without locks
    try:
        yield
    finally:
        lock.release()
        with suppress(OSError):  # somebody else's by now
            (folder / _LOCK).unlink(missing_ok=True)
            if empty and _names(folder) <= {manifest.FILE}:
                _undo(folder, made)


def _names(folder: Path) -> set[str]:
    """What a folder holds beside the lock."""
    return {path.name for path in folder.iterdir()} - {_LOCK}


def _undo(folder: Path, made: list[Path]) -> None:
    """Leave no trace of a start that finished no shard."""
    (folder / manifest.FILE).unlink(missing_ok=True)
    for place in made:
        place.rmdir()


@contextmanager
def _explained(folder: Path) -> Iterator[None]:
    """Turn errors of the operating system into `DatasetError` with the remedy."""
    try:
        yield
    except OSError as error:
        remedy = _REMEDIES.get(error.errno or 0, "Repair that")
        raise DatasetError(
            f"{folder}: {error.strerror or error}. The shards that are finished stay valid. "
            f"{remedy}, and run the same again: it goes on from there."
        ) from None
