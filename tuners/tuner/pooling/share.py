"""Share of each of several recordings in an answer, and how far it agrees with the others."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tuners.trust.intervals import Interval
from yawrate_env.plant.names import split

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Share:
    """One recording of several.

    Attributes
    ----------
    name : str
        Of the recording.
    measured : dict
        Its measured parameters.
    share : float
        Of the information that all recordings have.
    chi_square : float
        Squared distance of its estimate from that of the others together, over its covariance.
    freedom : int
        What `chi_square` is on average for one plant.
    chance : float
        How often recordings of one plant differ by as much.
    agrees : bool
        Whether chance explains the difference.
    shift : dict
        Metrics of the gains with this recording's plant, less those with the others'.
    parameters : dict
        Parameters of the plant fitted to it alone.
    causes : tuple of str
        What explains a difference, in words.
    """

    name: str
    measured: Mapping[str, float]
    share: float
    chi_square: float
    freedom: int
    chance: float
    agrees: bool
    shift: Mapping[str, float]
    parameters: Mapping[str, float]
    causes: tuple[str, ...] = ()

    def sentence(self, others: str = "the other recordings") -> str:
        """How the recording differs; empty where it does not."""
        if self.agrees:
            return ""
        parts = [
            f"{abs(value):.2g} {split(name)[1]}".rstrip()
            + f" {'more' if value > 0 else 'less'} {split(name)[0].replace('_', ' ')}"
            for name, value in self.shift.items()
            if np.isfinite(value)
        ]
        shown = f" shows {' and '.join(parts)} with these gains than {others}" if parts else (
            f" disagrees with {others}"
        )  # fmt: skip
        test = f" (χ² {self.chi_square:.0f}, by chance about {self.freedom})"
        return " ".join([f"{self.name}{shown}{test}.", *self.causes])


@dataclass(frozen=True, slots=True, eq=False)
class Validation:
    """A further recording, which the gains do not come from.

    Attributes
    ----------
    fit, attainable : float
        Share of its output that the tuned plant reproduces [%], and that a black box fitted to
        it does: ``100 (1 - |y - simulated|/|y - mean(y)|)``, as MATLAB's ``compare`` has it.
    intervals : dict
        Metrics of the gains as this recording tells, with 90 % intervals.
    within : bool
        Whether these intervals overlap with those of the result.
    matters : bool
        Whether a metric is off by more than its `error`.
    against : Share
        The recording against those tuned from, all together.
    """

    fit: float
    attainable: float
    intervals: Mapping[str, Interval]
    within: bool
    matters: bool
    against: Share = field(repr=False)

    @property
    def name(self) -> str:
        """Of the recording."""
        return self.against.name

    @property
    def agrees(self) -> bool:
        """Whether it may be the same plant: its own answer and its whole response agree."""
        return self.within and self.against.agrees

    @property
    def contradicts(self) -> bool:
        """Whether it disagrees by so much that the gains miss."""
        return self.matters and not self.agrees

    @property
    def sentence(self) -> str:
        """What the recording says of the answer, in words."""
        if self.agrees:
            return f"{self.name} agrees with these gains."
        verdict = "contradicts these gains" if self.matters else (
            "is another plant, or the same one changed, by so little that these gains still suit"
        )  # fmt: skip
        why = self.against.sentence("the recordings tuned from")
        return f"{self.name} {verdict}." + (f" {why}" if why else " The intervals do not overlap.")
