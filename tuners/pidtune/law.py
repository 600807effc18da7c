"""Controllers: the phase that each kind supplies, and its gains for a response at one frequency.

    C(s) = rho (1 + T s)^n / (s^m (1 + Tf s)^f)

=============  ===  ===  ===  =========================================
kind           n    m    f    supplies a phase between
=============  ===  ===  ===  =========================================
P, I           0    0/1  0    0 or -90 alone
PI             1    1    0    -90 and 0
PD, PDF        1    0    f    0 and 90 - alpha
PID, PIDF      2    1    f    alpha - 90 and 90 - alpha
=============  ===  ===  ===  =========================================

with ``alpha = atan(omega Tf)``.  A PID has one degree of freedom left.  Our rule gives its
two zeros one place, which is ``Ti = 4 Td`` where there is no filter (Ziegler and Nichols's
ratio): the PI rule supplies the lag, and a lead with the same zero the rest.  MATLAB splits
the zeros by an unpublished search; for 1/(s + 1)^3 at 1 rad/s its ratio is 4.4.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop import controller
from yawrate_env.loop.design import LEAST_LAG

Array = NDArray[np.float64]

# MATLAB's page prints Tf = 0.00875 for a PIDF with crossover 1 rad/s: half the lag that its
# PI keeps, tan(1.0027 deg / 2).
FILTER_LAG = LEAST_LAG / 2


@dataclass(frozen=True, slots=True)
class Kind:
    """Form of a controller.

    Attributes
    ----------
    zeros, integrators : int
        n and m.
    filtered : bool
        Whether the name asks for a derivative filter.
    free_phase : float
        Phase to aim for where the crossover may be chosen [rad].
    """

    zeros: int
    integrators: int
    filtered: bool
    free_phase: float

    @property
    def derives(self) -> bool:
        """Whether it has a derivative part."""
        return self.zeros > self.integrators


# MATLAB's page on pidtune prints crossover 0.5205 rad/s for a PI of 1/(s + 1)^3, which the
# phase of -37.51 degrees reproduces.  A PID then gives neither lead nor lag, and P and I
# meet the margin exactly.
KINDS = {
    "P": Kind(0, 0, False, 0.0),
    "I": Kind(0, 1, False, -np.pi / 2),
    "PI": Kind(1, 1, False, np.radians(-37.51)),
    "PD": Kind(1, 0, False, np.radians(30.0)),
    "PDF": Kind(1, 0, True, np.radians(30.0)),
    "PID": Kind(2, 1, False, 0.0),
    "PIDF": Kind(2, 1, True, 0.0),
}


@dataclass(frozen=True, slots=True)
class Law:
    """A controller in the factored form of the module's head; rho with its sign."""

    kind: Kind
    rho: float
    T: float
    Tf: float

    def gains(self) -> tuple[float, float, float]:
        """(Kp, Ki, Kd) of ``Kp + Ki/s + Kd s/(1 + Tf s)``."""
        a0, a1, a2 = self.rho * np.append(_power([self.T, 1.0], self.kind.zeros)[::-1], [0, 0])[:3]
        if not self.kind.integrators:
            return float(a0), 0.0, float(a1 - a0 * self.Tf)
        Kp = a1 - a0 * self.Tf
        return float(Kp), float(a0), float(a2 - Kp * self.Tf)

    def transfer_function(self, Ts: float) -> Any:
        """As a ``control.TransferFunction``, by Tustin's formula where `Ts` [s] is not 0."""
        import control

        f = int(self.kind.derives and self.Tf > 0)
        n, m = self.kind.zeros, self.kind.integrators
        if not Ts:
            num = _power([self.T, 1.0], n)
            lag = np.polymul(_power([1.0, 0.0], m), _power([self.Tf, 1.0], f))
            return control.tf(self.rho * num, lag)
        a = 2 / Ts  # 1 + T s becomes (1 + a T) z + (1 - a T), over z + 1
        zero, pole = ([1 + a * t, 1 - a * t] for t in (self.T, self.Tf))
        top = np.polymul(_power(zero, n), _power([1.0, 1.0], m + f - n))
        bottom = np.polymul(_power([a, -a], m), _power(pole, f))
        return control.tf(self.rho * top, bottom, Ts)


def reach(kind: Kind, omega: float, Tf: float) -> tuple[float, float]:
    """Least and largest phase that it supplies at `omega`, both excluded [rad]."""
    alpha = float(np.arctan(omega * Tf))
    low = alpha * (kind.zeros - 1 if kind.derives else 0) - kind.integrators * np.pi / 2
    return low, (kind.zeros - kind.integrators) * np.pi / 2 - alpha


def law(kind: Kind, log_magnitude: float, phase: float, omega: float, Tf: float) -> Law:
    """The controller with this response at `omega` [rad/s], its phase [rad] within `reach`."""
    alpha = np.arctan(omega * Tf)
    n, m = kind.zeros, kind.integrators
    if not n:
        return Law(kind, float(np.exp(log_magnitude) * omega**m), 0.0, 0.0)
    theta = (phase + m * np.pi / 2 + alpha) / n
    log_lead = np.log(np.cos(alpha)) - (n - m) * np.log(np.cos(theta))
    gain = log_magnitude - log_lead
    if not m:
        return Law(kind, float(np.exp(gain)), float(np.tan(theta) / omega), Tf)
    kp, T = controller.pi_gains(np.asarray(gain), np.asarray(theta - np.pi / 2), omega)
    return Law(kind, float(kp / T), float(T), Tf)


def _power(polynomial: list[float], exponent: int) -> Array:
    return np.asarray((np.poly1d(polynomial) ** exponent).coeffs, dtype=float)
