"""What a learner predicts instead of the gains themselves."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners import coordinates
from yawrate_env.task import Target

Array = NDArray[np.float64]
Names = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Coordinates:
    """Gains (B, k) to numbers whose errors matter alike for every plant, and back.

    Attributes
    ----------
    encode : callable
        Gains (B, k) to coordinates (B, m); ``nan`` where there are none.
    decode : callable
        Coordinates (B, m) to gains (B, k); ``nan`` where there are none.
    names : callable, optional
        What they are called in data sets, from the gains' names; ``coordinate_1``, ... if
        not given.
    """

    encode: Callable[[Array], Array]
    decode: Callable[[Array], Array]
    names: Callable[[Names], Names] | None = None


def _log(gains: Array) -> Array:
    return np.log(np.where(gains > 0, gains, np.nan))


LOG = Coordinates(_log, np.exp, lambda gains: tuple(f"log_{name}" for name in gains))
"""Logarithms: relative errors count; for gains that are positive."""


PLAIN = Coordinates(np.asarray, np.asarray, lambda gains: gains)
"""The gains themselves: absolute errors count."""


def loop(target: Target) -> Coordinates:
    """Log magnitude and phase of a PI controller (kp, Ti) at the wanted crossover.

    An error of phase is the same error of phase margin for every plant
    (`tuners.coordinates`).
    """

    def encode(gains: Array) -> Array:
        kp, Ti = np.where(gains > 0, gains, np.nan).T
        return coordinates.encode(kp, Ti, target, "loop")

    def decode(values: Array) -> Array:
        found = coordinates.decode(values, target, "loop")
        return np.stack([found.kp, found.Ti], axis=1)

    return Coordinates(encode, decode, lambda gains: ("log_gain", "phase"))
