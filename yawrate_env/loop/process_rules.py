"""Rules for processes, a gain and lags behind a dead time: SIMC, lambda (IMC) and AMIGO.

Each gives ``kp (1 + 1/(Ti s) + Td s)``, and the weight b of the reference in its proportional part.
With the wanted time constant tau_c of the closed loop, by default the dead time L,

simc
    K e^-Ls/(T s + 1): kp = T/(K (tau_c + L)), Ti = min(T, 4 (tau_c + L)), Td = L/3.
    K e^-Ls/((T1 s + 1)(T2 s + 1)): kp = T1/(K (tau_c + L)), Ti = min(T1, 4 (tau_c + L)), Td = T2.
lambda
    K e^-Ls/(T s + 1), PI: kp = T/(K (tau_c + L)), Ti = T.  PID: kp = (T + L/2)/(K (tau_c + L/2)),
    Ti = T + L/2, Td = T L/(2 T + L).
    K e^-Ls/((T1 s + 1)(T2 s + 1)): kp = (T1 + T2)/(K (tau_c + L)), Ti = T1 + T2,
    Td = T1 T2/(T1 + T2).
    K e^-Ls/s, PI: kp = (2 tau_c + L)/(K (tau_c + L)^2), Ti = 2 tau_c + L.  PID: kp =
    (2 tau_c + L)/(K (tau_c + L/2)^2), Ti = 2 tau_c + L, Td = (tau_c L + L^2/4)/(2 tau_c + L).

SIMC's are those of a PI and a lead in series, which become the sum above; a PI of two lags gets the
half rule.  An integrator is a lag of ``inf`` with the slope as its gain.  AMIGO (`amigo`) has no
speed to choose: its loops have a largest sensitivity of about 1.4.

Skogestad, J. Process Control 13, 2003; the lead L/3: Grimholt and Skogestad, J. Process Control 70,
2018.  Rivera, Morari and Skogestad, Ind. Eng. Chem. Process Des. Dev. 25, 1986; Chien and Fruehauf,
Chem. Eng. Prog. 86, 1990.  Astrom and Hagglund, J. Process Control 14, 2004, and *Advanced PID
Control*, section 7.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop import simc as simc_pi

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Process:
    """B processes, (B,) each.

    Attributes
    ----------
    gain : NDArray
        Steady gain, or the slope [1/s] of an integrator.
    lag, second_lag : NDArray
        [s]; ``inf`` for an integrator, 0 for none.
    dead_time : NDArray
        With the hold's half sample in it [s].
    """

    gain: Array
    lag: Array
    second_lag: Array
    dead_time: Array

    @property
    def first_order(self) -> "Process":
        """One lag for two by the half rule."""
        lag, dead_time = simc_pi.half_rule(self.lag, self.second_lag, self.dead_time)
        return Process(self.gain, lag, np.zeros_like(lag), dead_time)

    @property
    def slope(self) -> Array:
        """K/T, or that of an integrator."""
        return np.where(np.isinf(self.lag), self.gain, self.gain / self.lag)


@dataclass(frozen=True, slots=True, eq=False)
class Standard:
    """B controllers ``kp (b r - y + 1/(Ti s) e + Td s (c r - y))``, (B,) each; Td 0 of a PI."""

    kp: Array
    Ti: Array
    Td: Array
    b: Array


ProcessRule = Callable[[Process, bool, Array], Standard]
"""From processes, whether there is a derivative part, and tau_c (B,)."""


def simc(of: Process, derives: bool, tau_c: Array) -> Standard:
    """SIMC's PI or PID."""
    if not derives:
        of = of.first_order
    large, small = np.maximum(of.lag, of.second_lag), np.minimum(of.lag, of.second_lag)
    kp, Ti = simc_pi.simc(of.gain, large, of.dead_time, tau_c).T
    lead = np.where(small > 0, small, of.dead_time / 3) if derives else np.zeros_like(kp)
    factor = 1 + lead / Ti  # from PI and lead in series to their sum
    return Standard(kp * factor, Ti * factor, lead / factor, np.ones_like(kp))


def imc(of: Process, derives: bool, tau_c: Array) -> Standard:
    """Lambda tuning, which is internal model control with a filter of one lag."""
    if not derives:
        of = of.first_order
    L, one, T, T2 = of.dead_time, np.ones_like(of.gain), of.lag, of.second_lag
    integrates, two = np.isinf(T), T2 > 0
    T = np.where(integrates, 1.0, T)
    if not derives:
        kp = np.where(integrates, (2 * tau_c + L) / (tau_c + L) ** 2, T / (tau_c + L)) / of.gain
        return Standard(kp, np.where(integrates, 2 * tau_c + L, T), 0 * one, one)
    late = tau_c + L / 2
    numerator = np.select([integrates, two], [2 * tau_c + L, T + T2], T + L / 2)
    denominator = np.select([integrates, two], [late**2, tau_c + L], late)
    product = np.select([integrates, two], [tau_c * L + L**2 / 4, T * T2], T * L / 2)
    return Standard(numerator / denominator / of.gain, numerator, product / numerator, one)


def amigo(of: Process, derives: bool, tau_c: Array) -> Standard:
    """AMIGO's PI or PID; `tau_c` is not asked for."""
    of = of.first_order
    L, T, slope = of.dead_time, of.lag, of.slope
    late = np.where(np.isinf(T), 0.0, L / T)  # L/T
    b = np.where(late / (1 + late) > 0.5, 1.0, 0.0)
    if derives:
        kp = (0.2 * late + 0.45) / (slope * L)
        Ti = (0.4 * late + 0.8) / (late + 0.1) * L
        return Standard(kp, Ti, 0.5 * L / (0.3 * late + 1), b)
    kp = (0.15 * late + 0.35 - late / (1 + late) ** 2) / (slope * L)
    Ti = (0.35 + 13 / (1 + 12 * late + 7 * late**2)) * L
    return Standard(kp, Ti, np.zeros_like(kp), np.ones_like(b))


PROCESS_RULES: dict[str, ProcessRule] = {"simc": simc, "lambda": imc, "imc": imc, "amigo": amigo}
