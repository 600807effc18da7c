"""Signals of the test programs, the same in Python and in C: random bits into lags."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class GoldenSignals:
    """An experiment on a lag ``gain/(T s + 1)``; the template ``record.c`` is its C form.

    Of several outputs each is the lag of an input, and of half of all others.

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
    inputs: int = 1
    outputs: int = 1

    @classmethod
    def of(
        cls, pole: float, Ts: float, gain: float = 1.0, inputs: int = 1, outputs: int = 1
    ) -> Self:
        """A lag that functions with this pole [rad/s] explain, but none of them alone."""
        return cls(float(np.exp(-0.7 * pole * Ts)), gain, inputs=inputs, outputs=outputs)

    @property
    def rise(self) -> float:
        """What a unit input adds to the output in one sample."""
        return self.gain * (1 - self.decay)

    def __call__(self) -> tuple[Array, Array]:
        """Inputs and outputs, (1, N) each, or of several (1, m, N) and (1, q, N)."""
        u, y = (np.zeros((count, self.samples)) for count in (self.inputs, self.outputs))
        bits, commands, values = 1, np.zeros(self.inputs), np.zeros(self.outputs)
        shares = np.where(np.eye(self.outputs, self.inputs) > 0, 1.0, 0.5)
        for k in range(self.samples):
            values = self.decay * values + self.rise * (shares @ commands)
            if k % self.hold == 0:
                for i in range(self.inputs):
                    bits = (1664525 * bits + 1013904223) % 2**32
                    commands[i] = 0.02 if bits >> 31 else -0.02
            u[:, k], y[:, k] = commands, values
        return (u, y) if max(self.inputs, self.outputs) == 1 else (u[None], y[None])
