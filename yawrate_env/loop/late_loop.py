"""The closed loop of `closed_loop` where each plant has a dead time of its own.

Of a plant with fewer samples on their way than others, the last states do nothing.
"""

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop import controller
from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.target import Target


def late_loop(
    plant: DiscretePlant, kp: NDArray[np.float64], Ti: NDArray[np.float64], target: Target
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Close B loops; the answers are those of `closed_loop`, with the most d of the batch."""
    n1, n0, d0 = controller.coefficients(kp, Ti, target)
    n = plant.A.shape[1]
    C = output_row(plant, target)
    m = C.shape[1] + 1
    C_u = np.zeros((len(plant), m))
    C_u[:, :-1] = -n1[:, None] * C
    C_u[:, -1] = n0 - d0 * n1

    A = np.zeros((len(plant), m, m))
    B = np.zeros((len(plant), m))
    A[:, :n, :n] = plant.A
    for k in range(n, m - 2):
        A[:, k, k + 1] = 1.0
    delay = delays(plant, target)
    late = np.flatnonzero(delay)
    A[late, n + delay[late] - 1] = 0.0  # the command is the newest input on its way
    column = entrance(plant, delay, m)
    A += column[:, :, None] * C_u[:, None, :]
    B += column * n1[:, None]
    if len(late):
        A[late, :n, n] = plant.B[late]
    A[:, -1, :-1] = -target.Ts * C
    A[:, -1, -1] = 1 - d0 * target.Ts
    B[:, -1] = target.Ts
    return A, B, C_u, n1


def delays(plant: DiscretePlant, target: Target) -> NDArray[np.int64]:
    """Samples from the controller to the plant, (B,)."""
    delay = np.full(len(plant), target.delay_samples)
    return delay if plant.delay is None else delay + plant.delay


def entrance(plant: DiscretePlant, delay: NDArray[np.int64], m: int) -> NDArray[np.float64]:
    """Where an input with so many samples to go (B,) enters the m states, (B, m)."""
    n = plant.A.shape[1]
    column, late = np.zeros((len(plant), m)), np.flatnonzero(delay)
    column[:, :n] = np.where(delay == 0, plant.B.T, 0.0).T
    column[late, n + delay[late] - 1] = 1.0
    return column


def output_row(plant: DiscretePlant, target: Target) -> NDArray[np.float64]:
    """The output's row in the plant's states and the d inputs on their way, (B, n + d)."""
    n, delay = plant.A.shape[1], delays(plant, target)
    row = np.zeros((len(plant), n + int(delay.max(initial=0))))
    row[:, :n] = plant.C
    if plant.D is not None and row.shape[1] > n:
        row[:, n] = np.where(delay > 0, plant.D, 0.0)
    return row
