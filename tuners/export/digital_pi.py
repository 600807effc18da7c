"""The PI as a program runs it: one state, saturation, back-calculation, bumpless start.

    wanted = n1 e + x,   u = min(max(wanted, low), high)
    x      <- x + Ts n0 e + Ts/Tt (u - wanted)

with n1 = kp (1 + Ts/(2 Ti)) and n0 = kp/Ti: between the limits this is exactly the Tustin PI
of `yawrate_env.controller`.  At a limit the last term (Astrom and Hagglund, *Advanced PID
Control*, section 3.5) lets the state follow what the actuator does, with time constant Tt.
An error that is not finite holds the last output.
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env import controller, validation

Array = NDArray[np.float64]

LIMITS = (float(np.radians(-30.0)), float(np.radians(30.0)))
"""Road-wheel angle that the actuator is asked for, unless said otherwise [rad]."""

SLOWEST = 1e3  # [s]
_LEAST, _LARGEST = (float(x) for x in (np.finfo(np.float32).tiny, np.finfo(np.float32).max))


@dataclass(frozen=True, slots=True)
class DigitalPI:
    """A PI controller with its limits.

    Attributes
    ----------
    kp, Ti : float
        Gain [s] and integral time [s].
    Ts : float
        Sampling time [s].
    low, high : float
        Least and largest command [rad].
    """

    kp: float
    Ti: float
    Ts: float
    low: float = LIMITS[0]
    high: float = LIMITS[1]

    def __post_init__(self) -> None:
        for name in ("kp", "Ti"):
            validation.number(name, getattr(self, name), above=0.0,
                              remedy="Export gains that a tuner found.")  # fmt: skip
        validation.number("Ts", self.Ts, above=0.0, at_most=SLOWEST, remedy="Give it in seconds.")
        for name in ("low", "high"):
            validation.number(name, getattr(self, name), remedy="Give a finite limit in rad.")
        if not self.low < 0.0 < self.high:
            raise ValueError(
                f"limits = [{self.low:g}, {self.high:g}] must have low below 0 and high above. "
                "Give the least and the largest command in rad."
            )
        for name in ("gain", "step", "tracking", "low", "high"):
            validation.number(
                f"abs({name})", abs(getattr(self, name)), at_least=_LEAST, at_most=_LARGEST,
                remedy="Single precision must hold it: export kp, Ti, Ts and limits of ordinary "
                "size.",
            )  # fmt: skip

    @classmethod
    def of(cls, source: Any, Ts: float, limits: tuple[float, float] = LIMITS) -> Self:
        """From a pair (kp, Ti), or anything with attributes of these names."""
        if np.shape(limits) != (2,):
            raise ValueError(f"limits = {limits!r} must be two numbers, (low, high) in rad.")
        if hasattr(source, "kp") and hasattr(source, "Ti"):
            source = source.kp, source.Ti
        if not isinstance(source, tuple | list) or len(source) != 2:
            raise ValueError(
                f"a {type(source).__name__} holds no gains. Tune a recording first and export the "
                "result, or give (kp, Ti); a tuner itself goes to target onnx."
            )
        values = zip(("kp", "Ti", "Ts", "low", "high"), (*source, Ts, *limits), strict=True)
        return cls(*(validation.number(name, value) for name, value in values))

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
