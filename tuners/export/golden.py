"""Signals of the test programs, the same in Python and in C: random bits into a lag."""

from dataclasses import dataclass
from string import Template
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tuners.export import literals

Array = NDArray[np.float64]

_SAMPLES, _HOLD = 12_000, 60

_RECORD = Template("""\
static void record(${name}_state *state)
{
    uint32_t bits = 1u;
    double input = 0.0;
    double output = 0.0;
    long k;

    ${name}_start(state);
    for (k = 0; k < $samples; k++) {
        output = ($decay * output) + ($rise * input);
        if ((k % $hold) == 0) {
            bits = (1664525u * bits) + 1013904223u;
            input = ((bits >> 31) != 0u) ? 0.02 : -0.02;
        }
        ${name}_sample(state, input, output);
    }
}
""")


@dataclass(frozen=True, slots=True)
class GoldenSignals:
    """An experiment on a lag ``gain/(T s + 1)``.

    Attributes
    ----------
    decay : float
        ``exp(-Ts/T)``.
    gain : float
        Of the lag.
    """

    decay: float
    gain: float = 1.0

    @classmethod
    def of(cls, pole: float, Ts: float, gain: float = 1.0) -> Self:
        """A lag that functions with this pole [rad/s] explain, but none of them alone."""
        return cls(float(np.exp(-0.7 * pole * Ts)), gain)

    def __call__(self) -> tuple[Array, Array]:
        """Input and output, (1, N) each."""
        u, y = np.zeros((2, 1, _SAMPLES))
        bits, command, output, rise = 1, 0.0, 0.0, self.gain * (1 - self.decay)
        for k in range(_SAMPLES):
            output = self.decay * output + rise * command
            if k % _HOLD == 0:
                bits = (1664525 * bits + 1013904223) % 2**32
                command = 0.02 if bits >> 31 else -0.02
            u[0, k], y[0, k] = command, output
        return u, y

    def source(self, name: str) -> str:
        """``record`` in C, which gives them to the first stage of this name."""
        return _RECORD.substitute(
            name=name,
            samples=_SAMPLES,
            hold=_HOLD,
            decay=literals.number(self.decay),
            rise=literals.number(self.gain * (1 - self.decay)),
        )
