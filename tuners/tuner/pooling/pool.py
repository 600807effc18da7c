"""Gains for sets of recordings, what they rest on, and how far each recording agrees."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tuners.trust.checks import Assessment
from tuners.tuner.ladder import Climb
from tuners.tuner.pooling.joint import Joint

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

DISAGREE = "logs"
"""Name of the check whether recordings agree."""


@dataclass(frozen=True, slots=True, eq=False)
class Pool:
    """Gains for B sets of L recordings, and what they rest on.

    Attributes
    ----------
    climbed, assessment
        As for one recording.
    joint : Joint
        The plants fitted to all recordings of a set.
    theta : NDArray
        (B, p) measured parameters that the gains are for.
    shares : NDArray
        (L, B) of the information.
    chi_square, chance : NDArray
        (L, B) of each recording against the others.
    freedom : int
        Of the chi-squares.
    apart : NDArray
        (L, B) which recordings differ by more than chance.
    shift : NDArray
        (L, B, f) metrics of the gains with each recording's plant, less those with the others'.
    """

    climbed: Climb
    assessment: Assessment
    joint: Joint
    theta: Array
    shares: Array
    chi_square: Array
    chance: Array
    freedom: int
    apart: Flags
    shift: Array

    def explained(self, words: Sequence[str]) -> "Pool":
        """The same with a message on how recordings differ; for one set."""
        if not words:
            return self
        found = replace(self.assessment.findings[DISAGREE], message=" ".join(words))
        return replace(self, assessment=self.assessment.followed_by({DISAGREE: found}))
