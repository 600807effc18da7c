"""Drives of ``yawrate/PIRecalibration-v0`` for offline learning, as a Minari data set.

Drive k is that of ``reset(seed=seed + k)`` and follows behaviour ``k mod len(behaviours)`` in all
its windows.  With w uniform in [-1, 1]^2, coordinates of the gains are

| behaviour | action |
|---|---|
| `uniform` | w |
| `perturbed` | the oracle's + 0.2 w, clipped |
| `keep` | the gains of the start |
| `oracle` | those of the design rule for the vehicle of the window to come |
"""

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from tuners.data.minari_file import References, check_behaviours, check_new, written
from yawrate_env import RECALIBRATION_ID, validation
from yawrate_env.env.recalibration_env import PIRecalibrationVectorEnv

if TYPE_CHECKING:
    from minari import MinariDataset
    from minari.data_collector import EpisodeBuffer

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

DRIVE_BEHAVIOURS = ("uniform", "perturbed", "keep", "oracle")
LARGEST = 100_000

_PERTURBATION = 0.2
_BATCH = 256
_REFERENCE_DRIVES = 200


def export_drives(
    dataset_id: str,
    drives: int,
    seed: int = 0,
    *,
    behaviours: Sequence[str] = DRIVE_BEHAVIOURS,
    env_kwargs: dict[str, Any] | None = None,
    progress: Progress | None = None,
) -> "MinariDataset":
    """Write drives of ``yawrate/PIRecalibration-v0`` where Minari keeps its data sets.

    Parameters
    ----------
    dataset_id : str
        Minari's name of it, such as ``"yawrate/drives-v0"``.
    drives : int
        At most 100 000.
    seed : int
        Of the first drive, and of random actions.
    behaviours : sequence of str
        Behaviours in turn, of `DRIVE_BEHAVIOURS`.
    env_kwargs : dict, optional
        Further arguments of the environment.
    progress : callable, optional
        Called with the stage's name, how many drives are done, and of how many.

    Raises
    ------
    DatasetError
        There is one of that name already.
    """
    drives = validation.count("drives", drives, at_least=1, at_most=LARGEST)
    seed = validation.count("seed", seed, at_least=0)
    validation.instance("env_kwargs", env_kwargs or {}, dict, remedy="Give names with values.")
    check_behaviours(behaviours, DRIVE_BEHAVIOURS)
    check_new(dataset_id)
    kwargs = env_kwargs or {}
    env = gymnasium.make(RECALIBRATION_ID, **kwargs)
    description = (
        f"Drives of seeds {seed} to {seed + drives - 1}; behaviours in turn: "
        f"{', '.join(behaviours)}."
    )
    buffers = _buffers(kwargs, drives, seed, behaviours, progress)
    return written(
        dataset_id, env, behaviours, description, _references(kwargs, seed + drives), buffers
    )


def _buffers(
    kwargs: dict[str, Any],
    drives: int,
    seed: int,
    behaviours: Sequence[str],
    progress: Progress | None = None,
) -> "Iterator[EpisodeBuffer]":
    """Drives one after the other, a batch at a time."""
    turns = np.resize(np.array(behaviours), drives)
    for first in range(0, drives, _BATCH):
        yield from _driven(kwargs, turns[first : first + _BATCH], first, seed)
        if progress is not None:
            progress("exporting", min(first + _BATCH, drives), drives)


def _driven(
    kwargs: dict[str, Any], turns: NDArray[np.str_], first: int, seed: int
) -> "Iterator[EpisodeBuffer]":
    """A batch of drives that begins with drive `first`."""
    from minari.data_collector import EpisodeBuffer

    count, numbers = len(turns), range(first, first + len(turns))
    envs = PIRecalibrationVectorEnv(count, **kwargs)
    streams = [np.random.default_rng((seed, k)) for k in numbers]
    obs, _ = envs.reset(seed=[seed + k for k in numbers])
    seen, rows, lengths = [obs], [], np.zeros(count, np.int64)
    shape = envs.single_action_space.shape
    driving = np.ones(count, np.bool_)
    while driving.any():
        w = np.stack([each.uniform(-1, 1, shape) for each in streams])
        actions = _actions(envs, turns, w)
        obs, rewards, terminated, truncated, info = envs.step(actions.astype(np.float64))
        after, over = obs.copy(), terminated | truncated
        for i in np.flatnonzero(over).tolist():
            after[i] = info["final_obs"][i]
        seen.append(after)
        rows.append((actions, rewards, terminated, truncated))
        lengths += driving
        driving &= ~over
    observations = np.stack(seen)
    columns = [np.stack(column) for column in zip(*rows, strict=True)]
    for i, (k, T) in enumerate(zip(numbers, lengths.tolist(), strict=True)):
        actions, rewards, terminated, truncated = (column[:T, i] for column in columns)
        yield EpisodeBuffer(
            id=k,
            seed=seed + k,
            observations=observations[: T + 1, i],
            actions=actions,
            rewards=rewards.tolist(),
            terminations=terminated.tolist(),
            truncations=truncated.tolist(),
        )


def _actions(
    envs: PIRecalibrationVectorEnv, turns: NDArray[np.str_], w: Array
) -> NDArray[np.float32]:
    """Actions (B, 3 or 4) of behaviours (B,); none probes."""
    interface = envs.drives
    oracle = interface.actions(interface.drives.designed(envs.coming_theta))
    keep, uniform, perturbed = np.full_like(w, -1.0), np.full_like(w, -1.0), oracle.copy()
    uniform[:, :2], uniform[:, 2] = w[:, :2], 1.0
    perturbed[:, :2] = np.clip(oracle[:, :2] + _PERTURBATION * w[:, :2], -1, 1)
    chosen = np.select(
        [(turns == name)[:, None] for name in DRIVE_BEHAVIOURS], [uniform, perturbed, keep, oracle]
    )
    return np.asarray(chosen, dtype=np.float32)


def _references(kwargs: dict[str, Any], seed: int) -> References:
    """Mean returns of actions from the environment's box, and of the oracle, on further drives."""
    returns: list[float] = []
    for name in ("random", "oracle"):
        envs = PIRecalibrationVectorEnv(_REFERENCE_DRIVES, **kwargs)
        envs.reset(seed=seed)
        rng, turns = np.random.default_rng(seed), np.full(_REFERENCE_DRIVES, name)
        total, driving = np.zeros(_REFERENCE_DRIVES), np.ones(_REFERENCE_DRIVES, np.bool_)
        for _ in range(envs.drives.windows):
            w = rng.uniform(-1, 1, envs.action_space.shape)
            actions = w if name == "random" else _actions(envs, turns, w).astype(np.float64)
            _, rewards, terminated, _, _ = envs.step(actions)
            total += np.where(driving, rewards, 0.0)
            driving &= ~terminated
        returns.append(float(total.mean()))
    random, oracle = returns
    return References(random, oracle, _REFERENCE_DRIVES)
