"""Signals of the test programs, the same in Python and in C: random bits into a lag, and noise."""

from dataclasses import dataclass
from string import Template
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tuners.export import literals

Array = NDArray[np.float64]

_SAMPLES, _STEPS = 12_000, 200
_INPUT, _NOISE = 0.02, 0.001

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
        bits = (1664525u * bits) + 1013904223u;
        if ((k % $hold) == 0) {
            input = ((bits >> 31) != 0u) ? $input : -$input;
        }
        ${name}_sample(state, input, output + (((bits >> 31) != 0u) ? $noise : -$noise));
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
    samples : int
        How many there are.
    """

    decay: float
    gain: float
    samples: int

    @classmethod
    def of(cls, pole: float, Ts: float, gain: float = 1.0, longest: int | None = None) -> Self:
        """A lag that functions with this pole [rad/s] explain, but none of them alone."""
        return cls(float(np.exp(-0.7 * pole * Ts)), gain, longest or _SAMPLES)

    def __call__(self) -> tuple[Array, Array]:
        """Input and output, (1, N) each."""
        u, y = np.zeros((2, 1, self.samples))
        bits, command, output, rise = 1, 0.0, 0.0, self.gain * (1 - self.decay)
        for k in range(self.samples):
            output = self.decay * output + rise * command
            bits = (1664525 * bits + 1013904223) % 2**32
            sign = 1 if bits >> 31 else -1
            if k % self.hold == 0:
                command = sign * _INPUT
            u[0, k], y[0, k] = command, output + sign * self.noise
        return u, y

    @property
    def hold(self) -> int:
        """Samples from one input to the next."""
        return max(self.samples // _STEPS, 1)

    @property
    def noise(self) -> float:
        """What of the output is no lag's, but as the sign of the next random bit."""
        return self.gain * _NOISE

    def source(self, name: str) -> str:
        """``record`` in C, which gives them to the first stage of this name."""
        return _RECORD.substitute(
            name=name,
            samples=self.samples,
            hold=self.hold,
            decay=literals.number(self.decay),
            rise=literals.number(self.gain * (1 - self.decay)),
            input=literals.number(_INPUT),
            noise=literals.number(self.noise),
        )
