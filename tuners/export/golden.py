"""Signals of the test programs, the same in Python and in C: random bits into a lag."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class GoldenSignals:
    """An experiment on a lag ``gain/(T s + 1)``; the template ``record.c`` is its C form.

    Attributes
    ----------
    decay : float
        ``exp(-Ts/T)``.
    gain : float
        Of the lag.
    samples, hold : int
        Length of the recording and of each bit.
    """

    decay: float
    gain: float = 1.0
    samples: int = 12_000
    hold: int = 60

    @classmethod
    def of(cls, pole: float, Ts: float, gain: float = 1.0) -> Self:
        """A lag that functions with this pole [rad/s] explain, but none of them alone."""
        return cls(float(np.exp(-0.7 * pole * Ts)), gain)

    @property
    def rise(self) -> float:
        """What a unit input adds to the output in one sample."""
        return self.gain * (1 - self.decay)

    def __call__(self) -> tuple[Array, Array]:
        """Input and output, (1, N) each."""
        u, y = np.zeros((2, 1, self.samples))
        bits, command, output = 1, 0.0, 0.0
        for k in range(self.samples):
            output = self.decay * output + self.rise * command
            if k % self.hold == 0:
                bits = (1664525 * bits + 1013904223) % 2**32
                command = 0.02 if bits >> 31 else -0.02
            u[0, k], y[0, k] = command, output
        return u, y
