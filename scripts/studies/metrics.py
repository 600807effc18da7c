"""Statistics of errors, with intervals."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap

Array = NDArray[np.float64]

_RESAMPLES, _BATCH = 2000, 100


def rms_percent(truth: Array, estimate: Array) -> float:
    """Root mean square of the relative error in percent, eq. (14)."""
    return float(np.sqrt(np.mean((100 * (truth - estimate) / truth) ** 2)))


def rms(values: Array, axis: int = 0) -> Array:
    """Root mean square."""
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=axis)))


def ratio_of_rms(pairs: Array, axis: int = 0) -> Array:
    """Root mean square of the first over that of the second, for (..., B, 2) of both.

    For errors and their bounds on the same episodes: the ratio hardly depends on which
    vehicles were drawn.
    """
    found = rms(pairs, axis)
    return np.asarray(found[..., 0] / found[..., 1])


def bootstrap_interval(
    values: Array, statistic: Callable[..., Any], *, level: float = 0.95, seed: int = 0
) -> tuple[float, float]:
    """Percentile bootstrap interval of a statistic of (B, ...) values (Efron, 1979).

    Parameters
    ----------
    statistic : callable
        Such as ``np.mean`` or ``np.std``; called with ``axis``, that of the B rows.

    Returns
    -------
    float, float
        ``nan`` where a value is not finite.
    """
    if not np.isfinite(values).all():
        return np.nan, np.nan
    if len(values) == 1:
        only = float(statistic(values, axis=0))
        return only, only

    def of_rows(index: Array, axis: int = -1) -> Any:
        rows = index.astype(np.intp)
        return statistic(values[rows], axis=rows.ndim - 1)

    # Row numbers are resampled, not values, so that the columns of a row stay together.
    interval = bootstrap(
        (np.arange(len(values)),), of_rows, n_resamples=_RESAMPLES, batch=_BATCH,
        vectorized=True, method="percentile", confidence_level=level,
        rng=np.random.default_rng(seed),
    ).confidence_interval  # fmt: skip
    return float(interval.low), float(interval.high)
