"""Training examples: features of simulated recordings, and the design rule's gains."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.features import Features, with_measured
from yawrate_env.batch import concatenate, take
from yawrate_env.plant.episodes import Episodes, blocks, part
from yawrate_env.plant.parametrisation import Parametrisation
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, eq=False)
class Examples:
    """Training examples (m, ...); rows of one `number` differ by their noise alone.

    Attributes
    ----------
    number : NDArray
        (m,) which episode of the seed a row is of.
    theta : NDArray
        (m, p) its parameters.
    features : NDArray
        (m, n) features of its recording, and the measured parameters.
    usable : NDArray
        (m,) whether the first stage converged and the design rule reaches its target.
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

    def targets(self, coordinates: Parametrisation) -> Array:
        """The gains as a learner predicts them."""
        return coordinates.encode(self.gains)


def examples_of(
    plant: Plant,
    name: str,
    seed: int,
    first: int,
    count: int,
    features: Features,
    repeat: int = 0,
) -> Iterator[tuple[Examples, Episodes]]:
    """Examples of the episodes ``first`` to ``first + count`` of a set, and these episodes.

    Blocks are computed whole: features, too, depend in their last bits on the size of a batch.
    """
    for block, asked in blocks(plant, name, seed, first, count, repeat):
        measured = plant.measured_features(block.theta)
        values, usable = with_measured(features, block.u, block.y, plant.Ts, measured)
        gains, reached = plant.designs(block.theta)
        rows = Examples(block.number, block.theta, values, usable & reached, gains)
        yield take(rows, asked), part(block, asked)


def examples(
    plant: Plant,
    count: int,
    seed: int,
    features: Features,
    *,
    name: str = "train",
    noise_draws: int = 1,
    progress: Progress | None = None,
) -> Examples:
    """Simulate the first `count` episodes of a set and find their features.

    Parameters
    ----------
    noise_draws : int
        Record every plant so many times, with fresh noise.
    """
    parts: list[Examples] = []
    done = 0
    for repeat in range(noise_draws):
        for rows, _ in examples_of(plant, name, seed, 0, count, features, repeat):
            parts.append(rows)
            done += len(rows)
            if progress is not None:
                progress(done, count * noise_draws)
    return concatenate(parts)
