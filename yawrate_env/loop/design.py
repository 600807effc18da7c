"""The design rule R for a PI: loop shaping in closed form, what MATLAB's ``pidtune`` does.

At the wanted crossover the controller must supply magnitude ``1/|G|`` and phase
``psi = phi_m - 180 deg - arg G``, with arg G followed continuously from low frequency.
A PI supplies any phase between -90 and 0 degrees, and then exactly one (kp, Ti) does it.

* psi >= 0: a PI cannot lead.  As ``pidtune`` does, the crossover is kept and phase
  margin given up, with a little integral lag left.
* psi <= -90 deg: no positive (kp, Ti) does it: ``nan``.

`yawrate_env.loop.law` is the rule itself, for every kind from P to PIDF.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop import controller
from yawrate_env.loop.law import KINDS, LEAST_LAG, Status, supply, within_reach
from yawrate_env.loop.target import Target
from yawrate_env.loop.transfer_function import TransferFunction

__all__ = ["LEAST_LAG", "Design", "Status", "design", "design_from_response", "required_response"]


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """Gains for B plants.

    Attributes
    ----------
    kp, Ti : NDArray
        (B,) proportional gain and integral time [s]; ``nan`` where unreachable.
    status : NDArray
        (B,) of `Status`.
    """

    kp: NDArray[np.float64]
    Ti: NDArray[np.float64]
    status: NDArray[np.int64]


def required_response(
    plant: TransferFunction, target: Target
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What the controller must supply at the crossover: log magnitude and phase [rad]."""
    omega = np.append(np.logspace(-4, 0, 64, endpoint=False), 1.0) * target.omega_c
    undelayed = TransferFunction(plant.num, plant.den, plant.Ts)
    G = undelayed(omega)
    angle = np.angle(G)
    angle[:, 0] -= 2 * np.pi * (angle[:, 0] > np.pi / 2)  # a double integrator starts at -180
    phase = np.unwrap(angle, axis=1)[:, -1]
    lag = plant.delay_samples * plant.Ts * target.omega_c
    return -np.log(np.abs(G[:, -1])), np.radians(target.phase_margin) - np.pi - (phase - lag)


def design(plant: TransferFunction, target: Target) -> Design:
    """Tune one controller for every plant of the batch."""
    return design_from_response(*required_response(plant, target), target)


def design_from_response(
    log_magnitude: NDArray[np.float64], phase: NDArray[np.float64], target: Target
) -> Design:
    """Gains from a required response at the crossover, (B,) each [log 1, rad]."""
    if target.controller == "pi":
        found, status = supply(KINDS["PI"], log_magnitude, phase, controller.warped(target), 0.0)
        return Design(found.k, found.T, status)
    status, usable = within_reach(phase, -np.pi / 2, 0.0)
    status = np.where(np.isfinite(log_magnitude), status, Status.UNREACHABLE)
    kp, Ti = controller.gains(log_magnitude, usable, target)
    lost = status == Status.UNREACHABLE
    return Design(np.where(lost, np.nan, kp), np.where(lost, np.nan, Ti), status)
