"""Frequency response of a python-control system, with its phase in full turns.

A discrete system is mapped to the bilinear plane ``s = 2/Ts (z - 1)/(z + 1)``, where it is
a rational function again and ``omega`` becomes ``v = 2/Ts tan(omega Ts/2)``: one rule designs
for both, and Tustin's formula takes the controller back without any error at `omega`.

An argument is known only up to full turns, and the rule needs them.  With n poles in the
right half plane, a loop that is large below the crossover and small above it is stable
exactly if its phase, followed from -180 n degrees (and -90 more for each integrator) at
low frequency, is between -180 and 180 degrees at the crossover.  On that branch

* a pole at the origin gives -90 degrees, one to the left or on the axis goes from 0 to -90
  (a pair to -180), one to the right from -180 to -90 (a pair from -360 to -180);
* the numerator starts from 90 degrees for each zero at the origin, and is followed from
  there step by step.  Its roots are not used: those of a state space scatter, and a zero
  that is really at infinity comes out anywhere.

The branch presumes a positive gain at low frequency.  A plant that lacks it is turned by
its `sign`, and so is the controller then.
"""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation

Array = NDArray[np.float64]

_ROUNDING = 1e-9  # of the largest pole: what a pole at the origin or on the axis may be off
_DEFECTIVE = 1e-6  # the same where two of them have parted, as they do in a state space
_BELOW, _ABOVE = 100, 10  # the numerator is followed this far beyond the corners
_A_DECADE = 50
_POINTS = 4000  # at most, to follow it
_DELAY_SAMPLES = 200
_SPREAD = 1e9  # of the poles that a transfer function's coefficients can tell apart


@dataclass(frozen=True, slots=True, eq=False)
class System:
    """A single-input single-output system with delay.

    Attributes
    ----------
    sys : control.TransferFunction or control.StateSpace
        Without the delay.
    poles : NDArray
        In the s plane, or in the bilinear plane of a discrete system [rad/s].
    corners : NDArray
        Where poles, zeros and the delay are, as frequencies [rad/s].
    Ts : float
        Sampling time [s]; 0 for a continuous system.
    delay : float
        Pure delay [s].
    sign : float
        Of the controller's gains, 1 or -1.
    followed : tuple of NDArray
        Frequencies [rad/s], and the phase of the numerator there [rad].
    """

    sys: Any
    poles: NDArray[np.complex128]
    corners: Array
    Ts: float
    delay: float
    sign: float = 1.0
    followed: tuple[Array, Array] = (np.ones(1), np.zeros(1))

    @classmethod
    def of(cls, sys: Any, delay: float) -> Self:
        """Check a python-control system, find its poles and follow its phase."""
        _check(sys)
        Ts = float(sys.dt or 0.0)
        delay = validation.number("delay", delay, at_least=0.0, remedy="Give it in seconds.")
        if Ts and abs(delay / Ts - round(delay / Ts)) > 1e-9 * max(1.0, delay / Ts):
            raise ValueError(
                f"delay = {delay:g} s is not a multiple of the sampling time {Ts:g} s. Sample the "
                "continuous system with its delay instead."
            )
        if Ts:
            validation.number("delay", delay, at_most=_DELAY_SAMPLES * Ts,
                              remedy=f"It is {_DELAY_SAMPLES} samples at most: sample less "
                              "often.")  # fmt: skip
        zeros, poles = _roots(sys)
        if Ts:
            zeros, poles = _bilinear(zeros, Ts), _bilinear(poles, Ts)
        plant = cls(sys, poles, _corners(zeros, poles, Ts, delay), Ts, delay)
        return replace(plant, **plant._follow())

    def __call__(self, omega: Array) -> NDArray[np.complex128]:
        """Frequency response [rad/s], by python-control; the delay is exact."""
        omega = np.asarray(omega, dtype=float)
        at = np.exp(1j * omega * self.Ts) if self.Ts else 1j * omega
        with np.errstate(invalid="ignore"):  # infinite on a pole
            value = self.sys(at, warn_infinite=False) * np.exp(-1j * omega * self.delay)
        return np.asarray(value)

    def warped(self, omega: Array) -> Array:
        """Frequency in the plane of the poles."""
        return np.asarray(2 / self.Ts * np.tan(omega * self.Ts / 2) if self.Ts else omega)

    def phase(self, omega: Array) -> Array:
        """Phase of ``sign G`` in full turns [rad]."""
        omega = np.asarray(omega, dtype=float)
        about = self._pole_phase(omega) - omega * self.delay
        about += np.interp(np.log(omega), np.log(self.followed[0]), self.followed[1])
        angle = np.angle(self.sign * self(omega))
        return np.asarray(angle + 2 * np.pi * np.round((about - angle) / (2 * np.pi)))

    def largest_crossover(self) -> float:
        """Beyond which no discrete loop is designed, nine tenths of Nyquist's [rad/s]."""
        return 0.9 * np.pi / self.Ts if self.Ts else np.inf

    def polynomials(self) -> tuple[Array, Array]:
        """Numerator and denominator in s or z; the delay of a discrete system is in them."""
        import control

        if isinstance(self.sys, control.StateSpace):
            A, B, C, D = self.sys.A, self.sys.B, self.sys.C, self.sys.D
            den = np.poly(A).real
            num = np.poly(A - B @ C).real + (D[0, 0] - 1) * den
        else:
            num, den = self.sys.num[0][0], self.sys.den[0][0]
        samples = round(self.delay / self.Ts) if self.Ts else 0
        return np.asarray(num, dtype=float), np.append(den, np.zeros(samples))

    def _pole_phase(self, omega: Array) -> Array:
        v, total = self.warped(omega), np.zeros(np.shape(omega))
        limit = _ROUNDING * np.abs(self.poles).max(initial=0.0)
        for pole in self.poles:
            if abs(pole) <= limit:
                total -= np.pi / 2
            elif pole.real <= limit:
                total -= np.angle(1j * v - min(pole.real, 0.0) - 1j * pole.imag)
            else:
                total -= np.angle(1j * v - pole) % (2 * np.pi)
        return total

    def _follow(self) -> dict[str, Any]:
        """`sign`, and `followed` from below the first corner to above the last."""
        low, high = self._span()
        grid = np.geomspace(low, high, int(_A_DECADE * np.log10(high / low)) + 2)
        grid = np.unique(np.append(grid, self.corners[self.corners < high] * (1 + 1e-9)))
        while True:
            phase = np.unwrap(np.angle(self(grid)) + grid * self.delay - self._pole_phase(grid))
            coarse = np.flatnonzero(np.abs(np.diff(phase)) > np.pi / 4)
            if not len(coarse) or len(grid) > _POINTS:
                break
            middle = np.sqrt(grid[coarse] * grid[coarse + 1])
            narrow = np.diff(grid)[coarse] < 1e-12 * grid[coarse]  # a zero on the axis
            if narrow.all():
                break
            grid = np.sort(np.append(grid, middle[~narrow]))
        start = self._zeros_at_the_origin(low) * np.pi / 2
        halves = round(float((phase[0] - start) / np.pi))
        return {"sign": (-1.0) ** halves, "followed": (grid, phase - halves * np.pi)}

    def _zeros_at_the_origin(self, low: float) -> int:
        """By the slope of the numerator's magnitude."""
        omega = np.array([low, 2 * low])
        size = np.abs(self(omega)) * np.prod(
            np.abs(1j * self.warped(omega)[:, None] - self.poles), axis=1
        )
        return round(float(np.log2(size[1] / size[0]))) if size.all() else 0

    def _span(self) -> tuple[float, float]:
        corners = self.corners if len(self.corners) else np.ones(1)
        high = np.pi / self.Ts * (1 - 1e-9) if self.Ts else corners.max() * _ABOVE
        return min(corners.min(), high) / _BELOW, high


def _check(sys: Any) -> None:
    import control

    if not isinstance(sys, control.TransferFunction | control.StateSpace):
        raise ValueError(
            f"sys is a {type(sys).__name__}, expected a control.TransferFunction or "
            "control.StateSpace. Build one with control.tf or control.ss."
        )
    if (sys.ninputs, sys.noutputs) != (1, 1):
        raise ValueError(
            f"sys has {sys.ninputs} inputs and {sys.noutputs} outputs, expected one of each. "
            "Choose a channel with sys[i, j]."
        )
    if sys.dt is True:
        raise ValueError("sys.dt = True is no sampling time. Give it in seconds.")
    polynomial = isinstance(sys, control.TransferFunction)
    values = (sys.num[0][0], sys.den[0][0]) if polynomial else (sys.A, sys.B, sys.C, sys.D)
    if not all(np.isfinite(value).all() for value in values):
        raise ValueError("sys has a number that is not finite. Repair it.")
    try:
        zeros, poles = _roots(sys)
    except np.linalg.LinAlgError:
        raise ValueError(
            "sys has a leading coefficient so small that its roots overflow. Leave it out."
        ) from None
    size = np.abs(poles[poles != 0])
    if polynomial and size.max(initial=0.0) > _SPREAD * size.min(initial=np.inf):
        raise ValueError(
            f"sys has poles from {size.min():.3g} to {size.max():.3g}, a factor of more than "
            f"{_SPREAD:g}. Leave out leading or last coefficients that are next to nothing."
        )
    if polynomial and len(zeros) > len(poles):
        raise ValueError(
            f"sys has {len(zeros)} zeros and {len(poles)} poles, and is not proper. "
            "Add the poles that limit its bandwidth."
        )


def _roots(sys: Any) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Zeros and poles; of a transfer function's own polynomials, which control would normalise."""
    import control

    if isinstance(sys, control.TransferFunction):
        with np.errstate(over="ignore"):  # LinAlgError follows
            zeros, poles = np.roots(sys.num[0][0]), np.roots(sys.den[0][0])
    else:
        zeros, poles = sys.zeros(), sys.poles()
    return np.asarray(zeros, dtype=complex), np.asarray(poles, dtype=complex)


def _corners(
    zeros: NDArray[np.complex128], poles: NDArray[np.complex128], Ts: float, delay: float
) -> Array:
    """Poles, the zeros that are not far beyond them, and the delay."""
    size, fastest = np.abs(poles), np.abs(poles).max(initial=0.0)
    nearby = np.abs(zeros)[np.abs(zeros) <= 10 * fastest] if fastest else np.abs(zeros)
    size = np.unique(np.append(size, nearby))
    size = size[size > _DEFECTIVE * max(fastest, 2 / Ts if Ts else 0.0)]
    at = 2 / Ts * np.arctan(size * Ts / 2) if Ts else size
    matters = delay and (not len(at) or 1 / delay < 10 * at.max())
    return np.asarray(np.append(at, 1 / delay) if matters else at)


def _bilinear(roots: NDArray[np.complex128], Ts: float) -> NDArray[np.complex128]:
    finite = roots[np.abs(roots + 1) > 1e-12]  # z = -1 goes to infinity
    return np.asarray(2 / Ts * (finite - 1) / (finite + 1))
