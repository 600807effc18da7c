"""Rule R from P to PIDF: the gains that give a controller a wanted response at one frequency.

    C(s) = k ((1 + T s)/(T s))^m (1 + T s)^(n-m) / (1 + Tf s)^f

with ``k/s^m`` where n is 0, or

    C(s) = Kp + Ki/s + Kd s/(1 + Tf s)

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

In discrete time Tustin's formula stands for s, and omega is ``2/Ts tan(omega Ts/2)``: nothing
is lost at that frequency.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop import controller

Array = NDArray[np.float64]

# MATLAB's manual prints Kp 2.83, Ki 0.0495 and phase margin 43.9973 deg for 1/(s+1)^3 at
# 1 rad/s, which this lag reproduces to all its digits (1 deg exactly gives 44.0000).
LEAST_LAG = np.radians(1.0027)

# MATLAB's page prints Tf = 0.00875 for a PIDF with crossover 1 rad/s: half the lag that its
# PI keeps, tan(1.0027 deg / 2).
FILTER_LAG = LEAST_LAG / 2

_ROUNDING = 1e-9  # rad


class Status(IntEnum):
    """How far the target was reached."""

    OK = 0
    PHASE_LIMITED = 1
    UNREACHABLE = 2


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


@dataclass(frozen=True, slots=True, eq=False)
class Law:
    """B controllers in the factored form of the module's head.

    Attributes
    ----------
    kind : Kind
    k, T : NDArray
        (B,); T is 0 where there is no zero.
    Tf : float
        Filter time [s]; 0 where nothing is filtered.
    """

    kind: Kind
    k: Array
    T: Array
    Tf: float

    def gains(self) -> tuple[Array, Array, Array]:
        """(Kp, Ki, Kd), (B,) each, of ``Kp + Ki/s + Kd s/(1 + Tf s)``."""
        kind, k, T, Tf = self.kind, self.k, self.T, self.Tf
        none = np.zeros_like(k)
        if not kind.zeros:
            return (none, k, none) if kind.integrators else (k, none, none)
        if not kind.derives:
            return k, k / T, none
        if not kind.integrators:
            return k, none, k * (T - Tf)
        Ki = k / T
        Kp = 2 * k - Ki * Tf
        return Kp, Ki, k * T - Kp * Tf


def reach(kind: Kind, omega: float, Tf: float) -> tuple[float, float]:
    """Least and largest phase that it supplies at `omega`, both excluded [rad]."""
    alpha = float(np.arctan(omega * Tf))
    low = alpha * (kind.zeros - 1 if kind.derives else 0) - kind.integrators * np.pi / 2
    return low, (kind.zeros - kind.integrators) * np.pi / 2 - alpha


def filter_time(kind: Kind, omega: float, Ts: float = 0.0, Tf: float | None = None) -> float:
    """Time constant of the derivative filter [s]: a lag of half a degree at `omega` by default.

    In discrete time it is at least ``Ts/2``, with which the derivative is a backward difference.
    """
    if not kind.derives:
        return 0.0
    if not kind.filtered:
        return Ts / 2
    return float(max(np.tan(FILTER_LAG) / omega if Tf is None else Tf, Ts / 2))


def supply(
    kind: Kind, log_magnitude: Array, phase: Array, omega: float, Tf: float, spare: float = np.pi
) -> tuple[Law, NDArray[np.int64]]:
    """Rule R: controllers with a wanted response at `omega` [rad/s], and a `Status` each.

    Parameters
    ----------
    log_magnitude, phase : (B,) float64
        What they must supply [log 1, rad].  Where a kind cannot lead so much, the least lag is
        left and the phase given up; where it cannot lag so much, there is no controller, ``nan``.
        A P's and an I's phase is what it is: more than the wanted one is `Status.OK`.
    spare : float
        How much more phase than wanted a P or an I may supply [rad].
    """
    low, high = reach(kind, omega, Tf)
    if kind.zeros:
        status, usable = within_reach(phase, low, high)
    else:
        enough = (phase > high - spare) & (phase <= high + _ROUNDING)
        status = np.where(enough, Status.OK, Status.PHASE_LIMITED)
        usable = np.full_like(phase, high)
    status = np.where(np.isfinite(log_magnitude), status, Status.UNREACHABLE)
    found = law(kind, log_magnitude, usable, omega, Tf)
    lost = status == Status.UNREACHABLE
    k, T = np.where(lost, np.nan, found.k), np.where(lost, np.nan, found.T)
    return Law(kind, k, T, found.Tf), status


def within_reach(
    phase: NDArray[np.float64], low: float, high: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Status of phases (B,) that a controller must supply, and the phases to design for [rad].

    Parameters
    ----------
    low, high : float
        What the controller can supply, both ends excluded: -pi/2 and 0 for a PI.
    """
    status = np.select(
        [phase <= low, phase >= high], [Status.UNREACHABLE, Status.PHASE_LIMITED], Status.OK
    )
    status = np.where(np.isfinite(phase), status, Status.UNREACHABLE)
    return status, np.where(status == Status.OK, phase, high - LEAST_LAG)


def law(kind: Kind, log_magnitude: Array, phase: Array, omega: float, Tf: float) -> Law:
    """The controllers with this response at `omega` [rad/s], phases (B,) [rad] within `reach`."""
    alpha = float(np.arctan(omega * Tf))
    n, m = kind.zeros, kind.integrators
    if not n:
        k = np.exp(log_magnitude) * omega**m
        return Law(kind, k, np.zeros_like(k), 0.0)
    lag = (phase + alpha - (n - m) * np.pi / 2) / n  # of a PI with the same zero
    gain = log_magnitude - (np.log(np.cos(alpha)) - (n - m) * np.log(-np.sin(lag)))
    if not m:
        return Law(kind, np.exp(gain), -1 / (np.tan(lag) * omega), Tf)
    return Law(kind, *controller.pi_gains(gain, lag, omega), Tf)
