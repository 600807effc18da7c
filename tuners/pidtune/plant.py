"""A python-control system as the design rule sees it: its response, and its phase in full turns.

A discrete system is looked at in the bilinear plane ``s = 2/Ts (z - 1)/(z + 1)``, where it is
a rational function again and ``omega`` becomes ``v = 2/Ts tan(omega Ts/2)``: one rule designs
for both, and Tustin's formula takes the controller back without any error at `omega`.

An argument is known only up to full turns, and the rule needs them.  With n poles in the
right half plane, a loop that is large below the crossover and small above it is stable
exactly if its phase, followed from -180 n degrees (and -90 more for each integrator) at
low frequency, is between -180 and 180 degrees at the crossover.  That branch is a sum over
the roots:

==========================  =================================
root                        phase
==========================  =================================
pole, left or on the axis   0 to -180 for a pair, 0 to -90 alone
pole, right                 -180 to -90
zero, left                  0 to 90
zero, right                 0 to -90
pole, zero at the origin    -90, 90
==========================  =================================

It presumes a positive gain at low frequency.  A plant that lacks it is turned by its
`sign`, and so is the controller then.
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation

Array = NDArray[np.float64]

_ROOTS = 1e-9  # of the largest root: the rounding of a root at the origin or on the axis


@dataclass(frozen=True, slots=True, eq=False)
class Plant:
    """A single-input single-output system with delay.

    Attributes
    ----------
    system : control.TransferFunction or control.StateSpace
        Without the delay.
    zeros, poles : NDArray
        In the s plane, or in the bilinear plane of a discrete system [rad/s].
    Ts : float
        Sampling time [s]; 0 for a continuous system.
    delay : float
        Pure delay [s].
    sign : float
        Of the controller's gains, 1 or -1.
    """

    system: Any
    zeros: NDArray[np.complex128]
    poles: NDArray[np.complex128]
    Ts: float
    delay: float
    sign: float

    @classmethod
    def of(cls, sys: Any, delay: float) -> Self:
        """Check a python-control system and find its roots."""
        import control

        if not isinstance(sys, control.TransferFunction | control.StateSpace):
            raise ValueError(
                f"sys is a {type(sys).__name__}, wanted a control.TransferFunction or "
                "control.StateSpace. Build one with control.tf or control.ss."
            )
        if (sys.ninputs, sys.noutputs) != (1, 1):
            raise ValueError(
                f"sys has {sys.ninputs} inputs and {sys.noutputs} outputs, wanted one of each. "
                "Choose a channel with sys[i, j]."
            )
        if sys.dt is True:
            raise ValueError("sys.dt = True is no sampling time. Give it in seconds.")
        Ts = float(sys.dt or 0.0)
        zeros, poles = (np.asarray(roots, complex) for roots in (sys.zeros(), sys.poles()))
        if len(zeros) > len(poles):
            raise ValueError(
                f"sys has {len(zeros)} zeros and {len(poles)} poles, and is not proper. "
                "Add the poles that limit its bandwidth."
            )
        delay = validation.number("delay", delay, at_least=0.0, remedy="Give it in seconds.")
        if Ts and abs(delay / Ts - round(delay / Ts)) > 1e-9 * max(1.0, delay / Ts):
            raise ValueError(
                f"delay = {delay:g} s is not a multiple of the sampling time {Ts:g} s. Sample the "
                "continuous system with its delay instead."
            )
        if Ts:
            excess = len(poles) - len(zeros)
            zeros = np.append(_bilinear(zeros, Ts), np.full(excess, 2 / Ts))
            poles = _bilinear(poles, Ts)
        plant = cls(sys, zeros, poles, Ts, delay, 1.0)
        return cls(sys, zeros, poles, Ts, delay, plant._low_frequency_sign())

    def __call__(self, omega: Array) -> NDArray[np.complex128]:
        """Frequency response [rad/s], by python-control; the delay is exact."""
        omega = np.asarray(omega, dtype=float)
        at = np.exp(1j * omega * self.Ts) if self.Ts else 1j * omega
        return np.asarray(self.system(at, warn_infinite=False) * np.exp(-1j * omega * self.delay))

    def warped(self, omega: Array) -> Array:
        """Frequency in the plane of the roots."""
        return np.asarray(2 / self.Ts * np.tan(omega * self.Ts / 2) if self.Ts else omega)

    def phase(self, omega: Array) -> Array:
        """Phase of ``sign G`` in full turns [rad]."""
        omega = np.asarray(omega, dtype=float)
        followed = self._phase_by_roots(self.warped(omega)) - omega * self.delay
        angle = np.angle(self.sign * self(omega))
        return np.asarray(angle + 2 * np.pi * np.round((followed - angle) / (2 * np.pi)))

    def corners(self) -> Array:
        """Where the roots are, and the delay, as frequencies [rad/s]."""
        roots = np.concatenate([self.zeros, self.poles])
        size = np.unique(np.abs(roots))
        size = size[size > self._rounding()]
        at = 2 / self.Ts * np.arctan(size * self.Ts / 2) if self.Ts else size
        matters = self.delay and (not len(at) or 1 / self.delay < 10 * at.max())
        return np.asarray(np.append(at, 1 / self.delay) if matters else at)

    def largest_crossover(self) -> float:
        """Beyond which no discrete loop is designed, nine tenths of Nyquist's [rad/s]."""
        return 0.9 * np.pi / self.Ts if self.Ts else np.inf

    def polynomials(self) -> tuple[Array, Array]:
        """Numerator and denominator in s or z; the delay of a discrete system is in them."""
        import control

        rational = control.tf(self.system)
        num, den = rational.num[0][0], rational.den[0][0]
        samples = round(self.delay / self.Ts) if self.Ts else 0
        return np.asarray(num), np.append(den, np.zeros(samples))

    def _rounding(self) -> float:
        largest = np.abs(np.concatenate([self.zeros, self.poles])).max(initial=0.0)
        return float(_ROOTS * max(largest, 2 / self.Ts if self.Ts else 0.0))

    def _phase_by_roots(self, v: Array) -> Array:
        total = np.zeros(np.shape(v))
        limit = self._rounding()
        for roots, direction in ((self.zeros, 1), (self.poles, -1)):
            for root in roots:
                if abs(root) <= limit:
                    total += direction * np.pi / 2
                elif root.real <= limit:
                    total += direction * np.angle(1j * v - min(root.real, 0.0) - 1j * root.imag)
                elif direction == 1:
                    total += np.angle(root - 1j * v)
                else:
                    total -= np.angle(1j * v - root) % (2 * np.pi)
        return total

    def _low_frequency_sign(self) -> float:
        """Sign of the numerator at s = 0 where the denominator is monic, roots there left out."""
        v = np.pi * max(self._rounding() / _ROOTS, 1.0)  # not on a root
        omega = 2 / self.Ts * np.arctan(v * self.Ts / 2) if self.Ts else v
        undelayed = self(np.asarray(omega)) * np.exp(1j * omega * self.delay)
        leading = (
            undelayed * np.prod((1j * v - self.poles) / v) / np.prod((1j * v - self.zeros) / v)
        )
        right = (self.zeros.real > self._rounding()) & (
            np.abs(self.zeros.imag) <= 1e-9 * np.abs(self.zeros)
        )
        return float(np.sign(leading.real) or 1.0) * (-1.0) ** int(right.sum())


def _bilinear(roots: NDArray[np.complex128], Ts: float) -> NDArray[np.complex128]:
    finite = roots[np.abs(roots + 1) > 1e-12]  # z = -1 goes to infinity
    return np.asarray(2 / Ts * (finite - 1) / (finite + 1))
