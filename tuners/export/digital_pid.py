"""A controller of the PID's family as a program runs it: saturation, back-calculation, no bump.

    e = r - y,   d = c r - y
    D <- a D + g (d - d_before),   v = Kp (b r - y) + h e + x + D,   u = min(max(v, low), high)
    x <- x + s e + Ts/Tt (u - v)

with ``h = Ki Ts/2, s = Ki Ts, a = (2 Tf - Ts)/(2 Tf + Ts), g = 2 Kd/(2 Tf + Ts)``: between the
limits this is exactly the Tustin controller of `yawrate_env.loop.controllers`.  The derivative is
filtered, and differences of d are taken before they are scaled, so that single precision keeps
its digits.  At a limit the last term (Astrom and Hagglund, *Advanced PID Control*, section 3.5)
lets the integral follow what the actuator does, with time constant Tt; it stays between where it
was and what the limit needs, so that no single sample takes it to the opposite limit.  Errors
count up to `largest`, as in `tuners.export.digital_pi`; a reference or a measurement that is not
finite, or a reference beyond `beyond`, holds the last output.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.export.digital import (
    LARGEST,
    SATURATED,
    SLOWEST,
    check_limits,
    check_single,
    units,
)
from yawrate_env import validation

Array = NDArray[np.float64]

_BEYOND = 1e6  # of the largest error: references that no loop is for
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class DigitalPID:
    """A controller with its limits.

    Attributes
    ----------
    name : str
        Of the controller, as in ``PIDF``.
    Kp, Ki, Kd, Tf, b, c : float
        Of ``Kp (b r - y) + Ki/s e + Kd s/(1 + Tf s) (c r - y)``; Tf at least half a sample.
    Ts : float
        Sampling time [s].
    low, high : float
        Least and largest command, in its own unit.
    signals : tuple of str
        Names of the command and the measured output, with their units in brackets.
    """

    name: str
    Kp: float
    Ki: float
    Kd: float
    Tf: float
    b: float
    c: float
    Ts: float
    low: float
    high: float
    signals: tuple[str, str] = ("u", "y")

    def __post_init__(self) -> None:
        remedy = "Export gains that a tuner found."
        for name in ("Kp", "Ki", "b", "c"):
            validation.number(name, getattr(self, name), at_least=0.0, remedy=remedy)
        validation.number("Kd", self.Kd, remedy=remedy)
        validation.number("Ts", self.Ts, above=0.0, at_most=SLOWEST, remedy="Give it in seconds.")
        validation.number("Tf", self.Tf, at_least=self.Ts / 2 * (1 - _ROUNDING),
                          remedy="A faster filter needs a shorter Ts.")  # fmt: skip
        check_limits(self.low, self.high, self.units[0])
        validation.number("Kp + Ki Ts", self.Kp + self.step, above=0.0, remedy=remedy)
        check_single(self, (), ("Kp", "half", "step", "rate", "tracking", "largest"))

    @property
    def units(self) -> tuple[str, str]:
        """Of command and output; where a name has none, ``unit of u``."""
        return units(self.signals)

    @property
    def half(self) -> float:
        """h, the integral's part of the present error."""
        return self.Ki * self.Ts / 2

    @property
    def step(self) -> float:
        """s, the gain from the error to the integral."""
        return self.Ki * self.Ts

    @property
    def decay(self) -> float:
        """a, of the derivative from sample to sample; 0 with the fastest filter."""
        return max((2 * self.Tf - self.Ts) / (2 * self.Tf + self.Ts), 0.0)

    @property
    def rate(self) -> float:
        """g, the derivative's gain of a change."""
        return 2 * self.Kd / (2 * self.Tf + self.Ts)

    @property
    def tracking(self) -> float:
        """Ts/Tt; Tt is ``sqrt(Ti Td)``, or Ti without a derivative; 0 without an integral."""
        if not self.Ki:
            return 0.0
        Ti, Td = self.Kp / self.Ki, self.Kd / self.Kp if self.Kp else 0.0
        return self.Ts / max(np.sqrt(Ti * Td) if Td > 0 else Ti, self.Ts)

    @property
    def largest(self) -> float:
        """Size of error up to which errors count."""
        gain = max(self.Kp + self.half + abs(self.rate), self.step)
        return SATURATED * (self.high - self.low) / gain

    @property
    def beyond(self) -> float:
        """Size of reference beyond which the output is held."""
        return min(_BEYOND * self.largest, LARGEST)

    def run(self, reference: Array, measured: Array, *, start: tuple[float, float, float]) -> Array:
        """Commands (N,) for references and outputs (N,); what exported programs must reproduce.

        Parameters
        ----------
        start : (float, float, float)
            Reference, output and command before the first sample: if the first sample is the
            same, so is the first command.
        """
        output = min(max(start[2], self.low), self.high)
        error, last = self._seen(*start[:2])
        derivative, state = 0.0, output - self._proportional(error, start[0])
        commands = np.empty(len(reference))
        for k, (r, y) in enumerate(zip(reference, measured, strict=True)):
            if np.isfinite(y) and abs(r) <= self.beyond:
                error, d = self._seen(r, y)
                derivative = self.decay * derivative + self.rate * (d - last)
                last = d
                unlimited = self._proportional(error, r) + state + derivative
                output = min(max(unlimited, self.low), self.high)
                moved = state + self.step * error + self.tracking * (output - unlimited)
                if output != unlimited:
                    needed = output + self.Kp * (1 - self.b) * r
                    least, most = min(state, needed), max(state, needed)
                    moved = min(max(moved, least), most)
                state = moved
            commands[k] = output
        return commands

    def _seen(self, r: float, y: float) -> tuple[float, float]:
        """Error that counts, and what is differentiated."""
        error = min(max(r - y, -self.largest), self.largest)
        return error, error - (1 - self.c) * r

    def _proportional(self, error: float, r: float) -> float:
        return self.Kp * (error - (1 - self.b) * r) + self.half * error
