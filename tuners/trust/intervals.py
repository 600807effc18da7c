"""Intervals of the metrics: split conformal prediction (Lei et al., 2018).

An interval is the metric of the fitted plant plus or minus a factor times its standard
deviation; the factor makes intervals hold on calibration episodes, with the scaled error as
score.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEVEL = 0.9
GAUSSIAN = 1.6449
"""Half width of the interval of `LEVEL` in standard deviations, for a normal error."""


@dataclass(frozen=True, slots=True)
class Interval:
    """A prediction and the 90 % interval around it."""

    value: float
    low: float
    high: float


def conformal(predicted: Array, spread: Array, actual: Array, level: float = LEVEL) -> Array:
    """Split conformal factors (f,) from calibration episodes, (E, f) each.

    The factor is the ceil((E + 1) level)-th smallest scaled error, which makes intervals
    hold with probability `level` or more whatever the errors' distribution; too few
    episodes have none, and ``inf``.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        scores = np.abs(actual - predicted) / spread
    scores = np.where(actual == predicted, 0.0, scores)  # 0/0: it was certain
    scores = np.sort(np.where(np.isnan(scores), np.inf, scores), axis=0)
    rank = int(np.ceil((len(scores) + 1) * level))
    return np.asarray(scores[rank - 1] if rank <= len(scores) else np.full(scores.shape[1], np.inf))
