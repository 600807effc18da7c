"""The closed loop in state space: poles, stability and time response, batched.

States: the plant's, the d inputs on their way through dead time and computation delay (the
most of the batch), and the controller's integrator ``w+ = (1 - d0 Ts) w + Ts e``, with
``u = n1 e + (n0 - d0 n1) w`` and ``e = reference - y``.
"""

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import over_blocks
from yawrate_env.loop import controller
from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.target import Target

_BLOCK = 64


def closed_loop(
    plant: DiscretePlant, kp: NDArray[np.float64], Ti: NDArray[np.float64], target: Target
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Close B loops.

    Returns
    -------
    A : (B, m, m)
        Transition matrices, ``m = n + d + 1``.
    B : (B, m)
        Column of the reference.
    C_u, D_u : (B, m), (B,)
        The command ``u = C_u x + D_u reference``.
    """
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


def poles(
    plant: DiscretePlant, kp: NDArray[np.float64], Ti: NDArray[np.float64], target: Target
) -> NDArray[np.complex128]:
    """Closed-loop poles in z, (B, n + d + 1)."""
    A, *_ = closed_loop(plant, kp, Ti, target)
    found = np.empty(A.shape[:2], dtype=np.complex128)

    def some(i: int, j: int) -> None:
        found[i:j] = np.linalg.eigvals(A[i:j])

    over_blocks(some, len(A), _BLOCK)
    return found


def stable(
    plant: DiscretePlant, kp: NDArray[np.float64], Ti: NDArray[np.float64], target: Target
) -> NDArray[np.bool_]:
    """Whether all closed-loop poles lie inside the unit circle, (B,)."""
    return np.asarray((np.abs(poles(plant, kp, Ti, target)) < 1).all(axis=1))


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
    A, B, C_u, D_u = closed_loop(plant, kp, Ti, target)
    C, x = output_row(plant, target), np.zeros_like(B)
    dead = np.zeros(len(plant), np.int64) if plant.delay is None else plant.delay
    column = entrance(plant, dead, B.shape[1])
    y, u = (np.empty((len(B), len(reference))) for _ in range(2))
    for k, r in enumerate(reference):
        y[:, k] = np.einsum("bi,bi->b", C, x[:, :-1])
        u[:, k] = np.einsum("bi,bi->b", C_u, x) + D_u * r
        x = np.einsum("bij,bj->bi", A, x) + B * r
        if disturbance is not None:
            x += column * disturbance[k]
    return y, u
