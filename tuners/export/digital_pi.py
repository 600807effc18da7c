"""The PI as a program runs it: one state, saturation, back-calculation, bumpless start.

    v = n1 e + x,   u = min(max(v, low), high)
    x <- x + Ts n0 e + Ts/Tt (u - v)

with n1 = kp (1 + Ts/(2 Ti)) and n0 = kp/Ti: between the limits this is exactly the Tustin PI
of `yawrate_env.loop.controller`.  At a limit the last term (Astrom and Hagglund, *Advanced PID
Control*, section 3.5) lets the state follow what the actuator does, with time constant Tt; the
state stays between where it was and the limit, so that no single error, however large, takes it
to the opposite one.  Errors count up to `largest`, which saturates the output a thousand times
over: whatever is finite leaves the state finite.  One that is not holds the last output.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.export.digital import SATURATED, SLOWEST, check_limits, check_single, units
from yawrate_env import validation
from yawrate_env.loop import controller

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class DigitalPI:
    """A PI controller with its limits.

    Attributes
    ----------
    kp, Ti : float
        Gain and integral time [s].
    Ts : float
        Sampling time [s].
    low, high : float
        Least and largest command, in its own unit.
    signals : tuple of str
        Names of the command and the measured output, with their units in brackets.
    """

    kp: float
    Ti: float
    Ts: float
    low: float
    high: float
    signals: tuple[str, str] = ("u", "y")

    def __post_init__(self) -> None:
        for name in ("kp", "Ti"):
            validation.number(name, getattr(self, name), above=0.0,
                              remedy="Export gains that a tuner found.")  # fmt: skip
        validation.number("Ts", self.Ts, above=0.0, at_most=SLOWEST, remedy="Give it in seconds.")
        check_limits(self.low, self.high, self.units[0])
        check_single(self, ("gain", "step", "tracking", "largest"))

    @property
    def units(self) -> tuple[str, str]:
        """Of command and output; where a name has none, ``unit of u``."""
        return units(self.signals)

    @property
    def gain(self) -> float:
        """n1, the gain of the present error."""
        return float(self._coefficients()[0])

    @property
    def step(self) -> float:
        """Ts n0, the gain from the error to the state."""
        return float(self.Ts * self._coefficients()[1])

    @property
    def tracking(self) -> float:
        """Ts/Tt; Tt is the integral time, or the sampling time where that is longer."""
        return self.Ts / max(self.Ti, self.Ts)

    @property
    def largest(self) -> float:
        """Size of error up to which errors count."""
        return SATURATED * (self.high - self.low) / max(self.gain, self.step)

    def difference_equation(self) -> tuple[list[float], list[float]]:
        """(b, a) of ``a0 u[k] + a1 u[k-1] = b0 e[k] + b1 e[k-1]``, without limits."""
        return [self.gain, self.step - self.gain], [1.0, -1.0]

    def run(self, errors: Array, *, start: tuple[float, float] = (0.0, 0.0)) -> Array:
        """Commands (N,) for errors (N,); what exported programs must reproduce.

        Parameters
        ----------
        start : (float, float)
            Error and command before the first sample: if the first error is the same, so is
            the first command.
        """
        output = min(max(start[1], self.low), self.high)
        state = output - self.gain * self._counted(start[0])
        commands = np.empty(len(errors))
        for k, error in enumerate(errors):
            if np.isfinite(error):
                error = self._counted(error)
                unlimited = self.gain * error + state
                output = min(max(unlimited, self.low), self.high)
                moved = state + self.step * error + self.tracking * (output - unlimited)
                if output != unlimited:
                    least, most = min(state, output), max(state, output)
                    moved = min(max(moved, least), most)
                state = moved
            commands[k] = output
        return commands

    def _counted(self, error: float) -> float:
        return min(max(error, -self.largest), self.largest)

    def _coefficients(self) -> tuple[Array, Array]:
        return controller.pi_coefficients(np.asarray(self.kp), np.asarray(self.Ti), self.Ts)
