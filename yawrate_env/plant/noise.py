"""Noise at a given ratio to the output, as a plant's `noise`."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation

Array = NDArray[np.float64]

_DECIBELS = 400.0  # beyond float64's digits, either way


def snr(decibels: float) -> Callable[[Array], Array]:
    """Noise with a signal-to-noise ratio in `decibels`: of the noise-free output's mean square."""
    given = validation.number("snr", decibels, at_least=-_DECIBELS, at_most=_DECIBELS,
                              remedy="Give a ratio in dB.")  # fmt: skip
    return _Relative(10 ** (-given / 20))


@dataclass(frozen=True, slots=True)
class _Relative:
    """Standard deviations in proportion to the outputs' root mean squares."""

    ratio: float

    def __call__(self, y: Array) -> Array:
        return np.asarray(self.ratio * np.sqrt((y**2).mean(axis=1)))
