"""Random episodes of a plant, the same whatever batch they are asked for in.

Parameters and measurement noise come from words of an episode's own, as those of the
yaw-rate environment do.  A generator for what is random inside the simulator belongs to
a block of episodes, and blocks are computed whole, whatever part of them is asked for.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.compressors import Compressor
from tuners.plants.plant import Plant
from yawrate_env.batch import concatenate, take
from yawrate_env.contexts import context_set
from yawrate_env.episode import stream, uniform
from yawrate_env.noise import KEY_WORDS

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

_BLOCK = 64


@dataclass(frozen=True, slots=True, eq=False)
class Episodes:
    """B recorded experiments.

    Attributes
    ----------
    number : NDArray
        (B,) which episodes of their seed.
    theta : NDArray
        (B, p) the truth.
    y : NDArray
        (B, N) measured outputs.
    """

    number: NDArray[np.int64]
    theta: Array
    y: Array

    def __len__(self) -> int:
        return len(self.y)


@dataclass(frozen=True, slots=True, eq=False)
class Examples:
    """What a learner learns from, (B, …); rows of one `number` differ by their noise alone."""

    number: NDArray[np.int64]
    features: Array
    targets: Array
    usable: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.features)


def parameters(plant: Plant, words: NDArray[np.uint64]) -> Array:
    """Random words (B, p) to parameters of the prior (B, p)."""
    low, high = plant.ranges
    return np.asarray(low + (high - low) * uniform(words))


def episodes(
    plant: Plant, name: str, seed: int, first: int, count: int, repeat: int = 0
) -> Iterator[Episodes]:
    """Episodes ``first`` to ``first + count`` of a seed, block by block.

    Parameters
    ----------
    name : str
        Which of the sets that never share an episode: ``train``, ``test``, ``calibration``.
    repeat : int
        Another one has the same parameters, and fresh noise.
    """
    tag, p, stop = context_set(name).tag, len(plant.prior), first + count
    for start in range(first - first % _BLOCK, stop, _BLOCK):
        words = stream((tag, seed), start, _BLOCK, p + KEY_WORDS)
        root = (tag, seed, repeat) if repeat else (tag, seed)
        keys = stream(root, start, _BLOCK, p + KEY_WORDS)[:, p:]
        rng = np.random.default_rng(np.random.SeedSequence(root, spawn_key=(start, 1)))
        theta = parameters(plant, words[:, :p])
        asked = slice(max(first - start, 0), stop - start)
        number = np.arange(start, start + _BLOCK)
        yield take(Episodes(number, theta, plant.record(theta, keys, rng)), asked)


def examples(
    plant: Plant,
    count: int,
    seed: int,
    compressor: Compressor,
    *,
    noise_draws: int = 1,
    progress: Progress | None = None,
) -> Examples:
    """Simulate and compress the first `count` episodes of the ``train`` set."""
    parts: list[Examples] = []
    done = 0
    for repeat in range(noise_draws):
        for block in episodes(plant, "train", seed, 0, count, repeat):
            features, usable = compressor(plant.u[None], block.y, plant.Ts)
            targets = plant.coordinates.encode(plant.oracle(block.theta))
            usable = usable & np.isfinite(targets).all(axis=1)
            parts.append(Examples(block.number, features, targets, usable))
            done += len(block)
            if progress is not None:
                progress(done, count * noise_draws)
    return concatenate(parts)
