"""A PI controller in its usual forms: parallel, standard, and a difference equation."""

from dataclasses import dataclass

import numpy as np

from yawrate_env.loop import controller
from yawrate_env.loop.target import Target


@dataclass(frozen=True, slots=True)
class Forms:
    """Forms of a PI controller that runs every `Ts` seconds.

    Attributes
    ----------
    Kp, Ki, Ti : float
        Parallel form ``Kp + Ki/s`` and standard form ``Kp (1 + 1/(Ti s))``; the printed
        controller of eq. (13) has no integral gain, ``nan``.
    a1, b0, b1 : float
        ``u[k] = -a1 u[k-1] + b0 e[k] + b1 e[k-1]``, with ``e`` the reference minus the
        measured output.
    Ts : float
        Sampling time [s].
    """

    Kp: float
    Ki: float
    Ti: float
    a1: float
    b0: float
    b1: float
    Ts: float

    @classmethod
    def of(cls, kp: float, Ti: float, target: Target) -> "Forms":
        """From the standard form, as the loop's target discretises it."""
        columns = controller.coefficients(np.array([kp]), np.array([Ti]), target)
        n1, n0, d0 = (float(c[0]) for c in columns)
        Ki = kp / Ti if target.controller == "pi" else float("nan")
        return cls(kp, Ki, Ti, d0 * target.Ts - 1, n1, n0 * target.Ts - n1, target.Ts)

    @property
    def equation(self) -> str:
        """The difference equation as text."""
        last = "u[k-1]" if self.a1 == -1 else f"{-self.a1:.6g} u[k-1]"
        sign = "-" if self.b1 < 0 else "+"
        return f"u[k] = {last} + {self.b0:.6g} e[k] {sign} {abs(self.b1):.6g} e[k-1]"
