"""Random episodes of a plant, the same whatever batch they are asked for in.

Parameters, input and measurement noise come from words of an episode's own.  A generator
for what is random inside the simulator belongs to a block of episodes, and blocks are
computed whole, whatever part of them is asked for: BLAS sums in another order when a batch
is of another size, and the last bits of a row would depend on where a data set was cut.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tuners.features import Compressor
from yawrate_env.batch import concatenate, take
from yawrate_env.plant.parametrisation import Coordinates
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.noise import KEY_WORDS
from yawrate_env.signals.streams import stream, uniform
from yawrate_env.vehicle.contexts import context_set

Array = NDArray[np.float64]
Words = NDArray[np.uint64]
Progress = Callable[[int, int], None]

BLOCK = 128

_SEED = 20
_TRIED = 256


@dataclass(frozen=True, slots=True, eq=False)
class Draw:
    """B random experiments, before they are simulated.

    Attributes
    ----------
    theta : NDArray
        (B, p) parameters.
    u : NDArray
        (1, N) or (B, N) inputs.
    keys : NDArray
        (B, 4) noise streams.
    """

    theta: Array
    u: Array
    keys: Words

    @classmethod
    def of(cls, plant: Plant, words: Words) -> "Draw":
        """Turn random words (B, `words_of`) into experiments of the prior."""
        p = len(plant.prior)
        return cls(parameters(plant, words[:, :p]), plant.inputs(words[:, p]), words[:, p + 1 :])


@dataclass(frozen=True, slots=True, eq=False)
class Episodes:
    """B recorded experiments.

    Attributes
    ----------
    number : NDArray
        (B,) which episodes of their seed.
    theta : NDArray
        (B, p) the truth.
    u : NDArray
        (1, N) or (B, N) inputs.
    y : NDArray
        (B, N) measured outputs.
    """

    number: NDArray[np.int64]
    theta: Array
    u: Array
    y: Array

    def __len__(self) -> int:
        return len(self.y)


@dataclass(frozen=True, slots=True, eq=False)
class Examples:
    """What a learner learns from, (m, ...); rows of one `number` differ by their noise alone.

    Attributes
    ----------
    number : NDArray
        (m,) which episode of the seed a row is of.
    theta : NDArray
        (m, p) its parameters.
    features : NDArray
        (m, n) its compressed recording, and what is measured beside it.
    usable : NDArray
        (m,) whether the compression converged and the design rule has gains.
    gains : NDArray
        (m, k) the design rule's.
    """

    number: NDArray[np.int64]
    theta: Array
    features: Array
    usable: NDArray[np.bool_]
    gains: Array

    def __len__(self) -> int:
        return len(self.features)

    def targets(self, coordinates: Coordinates) -> Array:
        """The gains as a learner predicts them."""
        return coordinates.encode(self.gains)


def words_of(plant: Plant) -> int:
    """How many 64-bit words an episode takes: parameters, input, and the noise's key."""
    return len(plant.prior) + 1 + KEY_WORDS


def parameters(plant: Plant, words: Words) -> Array:
    """Random words (B, p) to parameters of the prior (B, p)."""
    low, high = plant.ranges
    return np.asarray(low + (high - low) * uniform(words))


def designed(plant: Plant) -> Array:
    """Gains (m, k) of 256 plants of the prior, those that have any; ``ValueError`` if none has."""
    gains = plant.oracle(sample(plant, _TRIED))
    found = gains[np.isfinite(gains).all(axis=1)]
    if not len(found):
        raise ValueError(
            f"design gives no gains for any of {_TRIED} plants of the prior: nothing can be "
            "learned. Choose a target that can be reached, or another prior."
        )
    return found


def sample(plant: Plant, count: int) -> Array:
    """(count, p) parameters of the prior that belong to no data set, always the same."""
    return parameters(plant, stream(_SEED, 0, count, len(plant.prior)))


def episodes(
    plant: Plant, name: str, seed: int, first: int, count: int, repeat: int = 0
) -> Iterator[Episodes]:
    """Episodes ``first`` to ``first + count`` of a seed, block by block.

    Parameters
    ----------
    name : str
        Which of the sets that never share an episode (`yawrate_env.vehicle.contexts`).
    repeat : int
        Another one has the same parameters and inputs, and fresh noise.
    """
    for block, asked in _blocks(plant, name, seed, first, count, repeat):
        yield _part(block, asked)


def recorded(plant: Plant, name: str, seed: int, count: int, repeat: int = 0) -> Episodes:
    """The first `count` episodes of a seed in one piece."""
    parts = list(episodes(plant, name, seed, 0, count, repeat))
    whole = concatenate(parts)
    return whole if len(whole.u) == len(whole) else replace(whole, u=parts[0].u)


def compressed(
    plant: Plant,
    name: str,
    seed: int,
    first: int,
    count: int,
    compressor: Compressor,
    repeat: int = 0,
) -> Iterator[tuple[Examples, Episodes]]:
    """What `episodes` gives, with what a learner learns from it."""
    for block, asked in _blocks(plant, name, seed, first, count, repeat):
        features, usable = compressor(block.u, block.y, plant.Ts)
        gains = plant.oracle(block.theta)
        usable = usable & np.isfinite(gains).all(axis=1)
        features = np.concatenate([features, plant.shown(block.theta)], axis=1)
        rows = Examples(block.number, block.theta, features, usable, gains)
        yield take(rows, asked), _part(block, asked)


def examples(
    plant: Plant,
    count: int,
    seed: int,
    compressor: Compressor,
    *,
    name: str = "train",
    noise_draws: int = 1,
    progress: Progress | None = None,
) -> Examples:
    """Simulate and compress the first `count` episodes of a set's seed.

    Parameters
    ----------
    noise_draws : int
        Record every plant so many times, with fresh noise.
    """
    parts: list[Examples] = []
    done = 0
    for repeat in range(noise_draws):
        for rows, _ in compressed(plant, name, seed, 0, count, compressor, repeat):
            parts.append(rows)
            done += len(rows)
            if progress is not None:
                progress(done, count * noise_draws)
    return concatenate(parts)


def _blocks(
    plant: Plant, name: str, seed: int, first: int, count: int, repeat: int
) -> Iterator[tuple[Episodes, slice]]:
    """Whole blocks, and which of their rows are asked for."""
    tag, stop = context_set(name).tag, first + count
    for start in range(first - first % BLOCK, stop, BLOCK):
        words = stream((tag, seed), start, BLOCK, words_of(plant))
        root = (tag, seed, repeat) if repeat else (tag, seed)
        if repeat:
            words[:, -KEY_WORDS:] = stream(root, start, BLOCK, words_of(plant))[:, -KEY_WORDS:]
        rng = np.random.default_rng(np.random.SeedSequence(root, spawn_key=(start, 1)))
        draw = Draw.of(plant, words)
        y = plant.measure(draw.theta, draw.u, draw.keys, rng)
        number = np.arange(start, start + BLOCK)
        yield Episodes(number, draw.theta, draw.u, y), slice(max(first - start, 0), stop - start)


def _part(block: Episodes, asked: slice) -> Episodes:
    u = block.u if len(block.u) == 1 else block.u[asked]
    return Episodes(block.number[asked], block.theta[asked], u, block.y[asked])
