"""The PI controller, and the paper's printed form of it.

Both are written in the delta operator ``delta = (z - 1)/Ts`` (Middleton and Goodwin,
1990), which keeps slow dynamics accurate at fast sampling:

    C = (n1 delta + n0) / (delta + d0)

=========  ==================================  =================  ============  ============
name       C(z)                                n1                 n0            d0
=========  ==================================  =================  ============  ============
pi         kp (1 + Ts/(2Ti) (z+1)/(z-1))       kp (1 + Ts/(2Ti))  kp / Ti       0
printed    eq. (13): Tustin of kp/(1 + Ti s)   kp Ts/(Ts + 2Ti)   2kp/(Ts+2Ti)  2/(Ts + 2Ti)
=========  ==================================  =================  ============  ============

With ``w = 2/Ts tan(omega Ts/2)`` the response at omega is ``kp (1 - j/(Ti w))`` for the
first and ``kp / (1 + j Ti w)`` for the second, so that a magnitude and a phase between
-90 and 0 degrees determine (kp, Ti) exactly, and the reverse.
"""

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop.target import Target


def coefficients(
    kp: NDArray[np.float64], Ti: NDArray[np.float64], target: Target
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """(n1, n0, d0) of the controller in the delta operator, each (B,)."""
    Ts = target.Ts
    if target.controller == "pi":
        return *pi_coefficients(kp, Ti, Ts), np.zeros_like(kp)
    return kp * Ts / (Ts + 2 * Ti), 2 * kp / (Ts + 2 * Ti), 2 / (Ts + 2 * Ti)


def pi_coefficients(
    kp: NDArray[np.float64], Ti: NDArray[np.float64], Ts: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n1, n0) of the Tustin PI, which has d0 = 0."""
    return kp * (1 + Ts / (2 * Ti)), kp / Ti


def response(
    kp: NDArray[np.float64], Ti: NDArray[np.float64], target: Target
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Natural log of the magnitude, and phase [rad], at the target crossover; (B,) each."""
    if target.controller == "pi":
        tangent = 1 / (Ti * warped(target))
        return np.log(kp) + 0.5 * np.log1p(tangent**2), -np.arctan(tangent)
    tangent = Ti * warped(target)
    return np.log(kp) - 0.5 * np.log1p(tangent**2), -np.arctan(tangent)


def gains(
    log_magnitude: NDArray[np.float64], phase: NDArray[np.float64], target: Target
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(kp, Ti) with this response at the target crossover; phase between -pi/2 and 0 rad."""
    if target.controller == "pi":
        return pi_gains(log_magnitude, phase, warped(target))
    tangent = -np.tan(phase)
    return np.exp(log_magnitude) * np.hypot(1, tangent), tangent / warped(target)


def pi_gains(
    log_magnitude: NDArray[np.float64], phase: NDArray[np.float64], omega: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(kp, Ti) of ``kp (1 + 1/(Ti s))`` with this response at ``s = j omega`` [rad/s]."""
    tangent = -np.tan(phase)
    return np.exp(log_magnitude) / np.hypot(1, tangent), 1 / (tangent * omega)


def warped(target: Target) -> float:
    """``w`` at the target crossover [rad/s]."""
    return 2 / target.Ts * float(np.tan(target.omega_c * target.Ts / 2))
