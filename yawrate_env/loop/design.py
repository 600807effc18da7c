"""The design rule R: loop shaping in closed form, what MATLAB's ``pidtune`` does for a PI.

At the wanted crossover the controller must supply magnitude ``1/|G|`` and phase
``psi = phi_m - 180 deg - arg G``, with arg G followed continuously from low frequency.
A PI supplies any phase between -90 and 0 degrees, and then exactly one (kp, Ti) does it.

* psi >= 0: a PI cannot lead.  As ``pidtune`` does, the crossover is kept and phase
  margin given up, with a little integral lag left.
* psi <= -90 deg: no positive (kp, Ti) does it: ``nan``.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop import controller
from yawrate_env.loop.margins import TransferFunction
from yawrate_env.loop.target import Target

# MATLAB's manual prints Kp 2.83, Ki 0.0495 and phase margin 43.9973 deg for 1/(s+1)^3 at
# 1 rad/s, which this lag reproduces to all its digits (1 deg exactly gives 44.0000).
LEAST_LAG = np.radians(1.0027)


class Status(IntEnum):
    """How far the target was reached."""

    OK = 0
    PHASE_LIMITED = 1
    UNREACHABLE = 2


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
    status, usable = within_reach(phase, -np.pi / 2, 0.0)
    status = np.where(np.isfinite(log_magnitude), status, Status.UNREACHABLE)
    kp, Ti = controller.gains(log_magnitude, usable, target)
    lost = status == Status.UNREACHABLE
    return Design(np.where(lost, np.nan, kp), np.where(lost, np.nan, Ti), status)


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
