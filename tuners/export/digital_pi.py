"""The PI as a program runs it: one state, saturation, back-calculation, bumpless start.

    wanted = n1 e + x,   u = min(max(wanted, low), high)
    x      <- x + Ts n0 e + Ts/Tt (u - wanted)

with n1 = kp (1 + Ts/(2 Ti)) and n0 = kp/Ti: between the limits this is exactly the Tustin PI
of `yawrate_env.loop.controller`.  At a limit the last term (Astrom and Hagglund, *Advanced PID
Control*, section 3.5) lets the state follow what the actuator does, with time constant Tt.
An error that is not finite holds the last output.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.loop import controller
from yawrate_env.plant.names import split

Array = NDArray[np.float64]

LIMITS = (float(np.radians(-30.0)), float(np.radians(30.0)))
"""Road-wheel angle that the actuator is asked for, unless said otherwise [rad]."""

SIGNALS = ("steering command [rad]", "yaw rate [rad/s]")
"""A vehicle's command, and what its loop controls."""

SLOWEST = 1e3  # [s]
_LEAST, _LARGEST = (float(x) for x in (np.finfo(np.float32).tiny, np.finfo(np.float32).max))


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
        What the command and the measured output are called, with their units in brackets.
    """

    kp: float
    Ti: float
    Ts: float
    low: float = LIMITS[0]
    high: float = LIMITS[1]
    signals: tuple[str, str] = SIGNALS

    def __post_init__(self) -> None:
        for name in ("kp", "Ti"):
            validation.number(name, getattr(self, name), above=0.0,
                              remedy="Export gains that a tuner found.")  # fmt: skip
        validation.number("Ts", self.Ts, above=0.0, at_most=SLOWEST, remedy="Give it in seconds.")
        for name in ("low", "high"):
            validation.number(name, getattr(self, name),
                              remedy=f"Give a finite limit in {self.units[0]}.")  # fmt: skip
        if not self.low < self.high:
            raise ValueError(
                f"limits = [{self.low:g}, {self.high:g}] must have low below high. "
                f"Give the least and the largest command in {self.units[0]}."
            )
        for name in ("gain", "step", "tracking", "low", "high"):
            size = abs(getattr(self, name))
            least = 0.0 if name in ("low", "high") and size == 0.0 else _LEAST
            validation.number(
                f"abs({name})", size, at_least=least, at_most=_LARGEST,
                remedy="Single precision must hold it: export kp, Ti, Ts and limits of ordinary "
                "size.",
            )  # fmt: skip

    @property
    def units(self) -> tuple[str, str]:
        """Of command and output; where a name has none, ``unit of u``."""
        command, output = map(unit, self.signals)
        return command, output

    @property
    def gain(self) -> float:
        """n1, the gain of the present error."""
        return float(self._coefficients()[0])

    @property
    def step(self) -> float:
        """Ts n0, what the error adds to the state."""
        return float(self.Ts * self._coefficients()[1])

    @property
    def tracking(self) -> float:
        """Ts/Tt; Tt is the integral time, or the sampling time where that is longer."""
        return self.Ts / max(self.Ti, self.Ts)

    def difference_equation(self) -> tuple[list[float], list[float]]:
        """(b, a) of ``a0 u[k] + a1 u[k-1] = b0 e[k] + b1 e[k-1]``, without limits."""
        return [self.gain, self.step - self.gain], [1.0, -1.0]

    def run(self, errors: Array, *, start: tuple[float, float] = (0.0, 0.0)) -> Array:
        """Commands (N,) for errors (N,); the program's reference.

        Parameters
        ----------
        start : (float, float)
            Error and command at the start: the first command is that one if the first
            error is.
        """
        output = min(max(start[1], self.low), self.high)
        state = output - self.gain * start[0]
        commands = np.empty(len(errors))
        for k, error in enumerate(errors):
            if np.isfinite(error):
                wanted = self.gain * error + state
                output = min(max(wanted, self.low), self.high)
                state += self.step * error + self.tracking * (output - wanted)
            commands[k] = output
        return commands

    def _coefficients(self) -> tuple[Array, Array]:
        return controller.pi_coefficients(np.asarray(self.kp), np.asarray(self.Ti), self.Ts)


def unit(signal: str) -> str:
    """What a signal's name has in brackets."""
    name, bracket = split(signal.strip())
    return bracket or f"unit of {name}"
