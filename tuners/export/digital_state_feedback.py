"""A state feedback as a program runs it: reference and states, weighted, between the limits.

    u = min(max(kr r - k1 x1 - ... - kn xn, low), high)

It has no state of its own, so that nothing winds up; a sample that is not finite holds the last
output.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.export.digital import check_limits, unit
from yawrate_env import validation

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class DigitalStateFeedback:
    """A state feedback with its limits.

    Attributes
    ----------
    gains : dict
        Of the states, by name.
    reference_gain : float
        kr.
    Ts : float
        Sampling time [s].
    low, high : float
        Least and largest command, in its own unit.
    signals : tuple of str
        Names of the command and the output, with their units in brackets.
    """

    gains: dict[str, float]
    reference_gain: float
    Ts: float
    low: float
    high: float
    signals: tuple[str, str] = ("u", "y")

    def __post_init__(self) -> None:
        for name, value in {**self.gains, "reference_gain": self.reference_gain}.items():
            validation.number(name, value, remedy="Export gains that a tuner found.")
        validation.number("Ts", self.Ts, above=0.0, remedy="Give it in seconds.")
        check_limits(self.low, self.high, unit(self.signals[0]))

    def run(self, reference: Array, states: Array, *, start: float = 0.0) -> Array:
        """Commands (N,) for references (N,) and states (N, n), from a command before them."""
        output, commands = min(max(start, self.low), self.high), np.empty(len(reference))
        k = np.array(list(self.gains.values()))
        for i, (r, x) in enumerate(zip(reference, states, strict=True)):
            unlimited = self.reference_gain * r
            for gain, value in zip(k, x, strict=True):
                unlimited -= gain * value
            if np.isfinite(unlimited):
                output = min(max(unlimited, self.low), self.high)
            commands[i] = output
        return commands
