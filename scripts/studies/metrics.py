"""Figures of merit, with intervals."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_RESAMPLES = 2000


def rms_percent(truth: Array, estimate: Array) -> float:
    """Root mean square of the relative error in percent, eq. (14)."""
    return float(np.sqrt(np.mean((100 * (truth - estimate) / truth) ** 2)))


def rms(values: Array, axis: int = 0) -> Array:
    """Root mean square."""
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=axis)))


def ratio_of_rms(pairs: Array, axis: int = 0) -> Array:
    """Root mean square of the first over that of the second, for (..., B, 2) of both.

    Of errors and their bounds on the same episodes: what is far from the bound everywhere
    has a ratio that hardly depends on which vehicles were drawn.
    """
    found = rms(pairs, axis)
    return np.asarray(found[..., 0] / found[..., 1])


def bootstrap_interval(
    values: Array, statistic: Callable[..., Array], *, level: float = 0.95, seed: int = 0
) -> tuple[float, float]:
    """Percentile bootstrap interval of a statistic of (B, ...) values (Efron, 1979).

    Parameters
    ----------
    statistic : callable
        Such as ``np.mean`` or ``np.std``; called with ``axis=1``.
    """
    rng = np.random.default_rng(seed)
    found = [
        statistic(values[rng.integers(0, len(values), (100, len(values)))], axis=1)
        for _ in range(_RESAMPLES // 100)
    ]
    low, high = np.quantile(np.concatenate(found), [(1 - level) / 2, (1 + level) / 2])
    return float(low), float(high)
