"""What a learner predicts instead of the gains themselves."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.tuner import coordinates
from yawrate_env.loop.target import Target

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

    @property
    def target(self) -> Target | None:
        """The loop whose controller they describe, where they are those of `loop`."""
        owner = getattr(self.decode, "__self__", None)
        return owner.target if isinstance(owner, _Loop) else None


def _log(gains: Array) -> Array:
    return np.log(np.where(gains > 0, gains, np.nan))


def _exp(values: Array) -> Array:
    with np.errstate(over="ignore"):  # far from all that was learned
        return _positive(np.exp(values))


def _positive(gains: Array) -> Array:
    """Gains (B, k); ``nan`` where not all of them are positive and finite."""
    usable = (gains > 0) & np.isfinite(gains)
    return np.where(usable.all(axis=1, keepdims=True), gains, np.nan)


def _logged(gains: Names) -> Names:
    return tuple(f"log_{name}" for name in gains)


def _unchanged(gains: Names) -> Names:
    return gains


LOG = Coordinates(_log, _exp, _logged)
"""Logarithms: relative errors count; for gains that are positive."""


PLAIN = Coordinates(np.asarray, _positive, _unchanged)
"""The gains themselves: absolute errors count; for gains that are positive."""


def loop(target: Target) -> Coordinates:
    """Log magnitude and phase of a PI controller (kp, Ti) at the wanted crossover.

    An error of phase is the same error of phase margin for every plant
    (`tuners.tuner.coordinates`).
    """
    at = _Loop(target)
    return Coordinates(at.encode, at.decode, at.names)


@dataclass(frozen=True, slots=True)
class _Loop:
    target: Target

    def encode(self, gains: Array) -> Array:
        kp, Ti = np.where(gains > 0, gains, np.nan).T
        return coordinates.encode(kp, Ti, self.target, "loop")

    def decode(self, values: Array) -> Array:
        found = coordinates.decode(values, self.target, "loop")
        return np.stack([found.kp, found.Ti], axis=1)

    def names(self, gains: Names) -> Names:
        return "log_gain", "phase"
