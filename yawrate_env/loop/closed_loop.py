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
from yawrate_env.loop.late_loop import entrance, late_loop, output_row
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
    if plant.delay is not None:
        return late_loop(plant, kp, Ti, target)
    n1, n0, d0 = controller.coefficients(kp, Ti, target)
    n, d = plant.A.shape[1], target.delay_samples
    m = n + d + 1
    C_u = np.zeros((len(plant), m))
    C_u[:, :n] = -n1[:, None] * plant.C
    C_u[:, -1] = n0 - d0 * n1

    A = np.zeros((len(plant), m, m))
    B = np.zeros((len(plant), m))
    A[:, :n, :n] = plant.A
    if d == 0:
        A[:, :n] += plant.B[:, :, None] * C_u[:, None, :]
        B[:, :n] = plant.B * n1[:, None]
    else:
        A[:, :n, n] = plant.B
        for k in range(n, n + d - 1):
            A[:, k, k + 1] = 1.0
        A[:, n + d - 1] = C_u
        B[:, n + d - 1] = n1
    A[:, -1, :n] = -target.Ts * plant.C
    A[:, -1, -1] = 1 - d0 * target.Ts
    B[:, -1] = target.Ts
    return A, B, C_u, n1


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
