"""PI loops in state space: poles, stability and time response, batched (`loop.feedback`)."""

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.feedback import Compensator, Feedback
from yawrate_env.loop.target import Target


def poles(
    plant: DiscretePlant, kp: NDArray[np.float64], Ti: NDArray[np.float64], target: Target
) -> NDArray[np.complex128]:
    """Closed-loop poles in z, (B, n + d + 1)."""
    return _closed(plant, kp, Ti, target).poles


def stable(
    plant: DiscretePlant, kp: NDArray[np.float64], Ti: NDArray[np.float64], target: Target
) -> NDArray[np.bool_]:
    """Whether all closed-loop poles lie inside the unit circle, (B,)."""
    return _closed(plant, kp, Ti, target).stable


def time_response(
    plant: DiscretePlant,
    kp: NDArray[np.float64],
    Ti: NDArray[np.float64],
    target: Target,
    reference: NDArray[np.float64],
    disturbance: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Response from rest to a reference, and to a disturbance if there is one.

    Parameters
    ----------
    reference : (N,) float64
        Yaw-rate reference at the controller's sampling time [rad/s].
    disturbance : (N,) float64, optional
        Added to the steering command at the plant's input [rad].

    Returns
    -------
    y, u : (B, N) float64
        Yaw rate [rad/s] and steering command [rad].
    """
    return _closed(plant, kp, Ti, target).respond(reference, disturbance)


def _closed(
    plant: DiscretePlant, kp: NDArray[np.float64], Ti: NDArray[np.float64], target: Target
) -> Feedback:
    return Feedback.of(plant, Compensator.of(kp, Ti, target), target.delay_samples)
