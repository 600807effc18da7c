"""The parallel form of a PID and its relatives, and the compensator that it is when sampled."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop.feedback import Compensator
from yawrate_env.loop.transfer_function import product

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Parallel:
    """B controllers ``Kp (b r - y) + Ki/s e + Kd s/(1 + Tf s) (c r - y)``.

    Attributes
    ----------
    Kp, Ki, Kd, Tf, b, c : NDArray
        (B,) each.
    integrates, derives : bool
        Whether Ki and Kd may differ from 0.
    """

    Kp: Array
    Ki: Array
    Kd: Array
    Tf: Array
    b: Array
    c: Array
    integrates: bool
    derives: bool

    def compensator(self, Ts: float) -> Compensator:
        """Sampled by Tustin's formula: ``1/s`` is ``(1 + h delta)/delta`` with ``h = Ts/2``."""
        one, h = np.ones_like(self.Kp), Ts / 2
        integral = (np.stack([h * self.Ki, self.Ki], axis=1), np.stack([one, 0 * one], axis=1))
        rate = 1 / (self.Tf + h)
        derivative = np.stack([rate * self.Kd, 0 * one], axis=1), np.stack([one, rate], axis=1)
        bottom = one[:, None]
        reference, output = (self.Kp * self.b)[:, None], self.Kp[:, None]
        if self.integrates:
            top, delta = integral
            reference, output = (
                product(part, delta) + product(top, bottom) for part in (reference, output)
            )
            bottom = product(bottom, delta)
        if self.derives:
            top, pole = derivative
            reference = product(reference, pole) + self.c[:, None] * product(top, bottom)
            output = product(output, pole) + product(top, bottom)
            bottom = product(bottom, pole)
        return Compensator(reference, output, bottom)
