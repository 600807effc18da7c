"""Random integers of numbered episodes, the same in any batch."""

import numpy as np
from numpy.typing import NDArray


def stream(root: int | tuple[int, ...], first: int, count: int, words: int) -> NDArray[np.uint64]:
    """64-bit integers (count, words) of episodes ``first`` to ``first + count`` of a seed."""
    return np.stack(
        [
            np.random.SeedSequence(root, spawn_key=(episode,)).generate_state(words, np.uint64)
            for episode in range(first, first + count)
        ]
    )


def uniform(words: NDArray[np.uint64]) -> NDArray[np.float64]:
    """Random integers to numbers in [0, 1)."""
    return np.asarray((words >> np.uint64(11)) * 2.0**-53)
