"""Types of what learners are trained on, and of how they report."""

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

Batches = Iterable[tuple[NDArray[np.float64], NDArray[np.float64]]]
"""Features (m, n) and targets (m, t), batch by batch, and again at every iteration."""

Progress = Callable[[int, int], None]
"""Called with how far the training is, and how far it goes."""


def gathered(batches: Batches) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Features (m, n) and targets (m, t) of all batches, for learners that need them at once."""
    X, T = zip(*batches, strict=True)
    return np.concatenate(X), np.concatenate(T)
