"""Closed-loop drives: a batch of vehicles under PI control, window by window.

Controller and logger run at the target's sampling time, the vehicle is exact in between (its
zero-order hold).  Gyro noise v and steering disturbance d act inside the loop:

    e[k] = reference[k] - y[k],                y[k] = C x[k] + D s[k - delay] + v[k]
    u[k] = (1 - d0 Ts) u[k-1] + n1 (e[k] - e[k-1]) + n0 Ts e[k-1]
    x[k+1] = A x[k] + B s[k - delay],          s[k] = u[k - delay_samples] + d[k]

with the controller of `yawrate_env.loop.controller` in its velocity form, in which new gains
change the command from the next sample on, and never at once (Astrom and Hagglund, 2006,
sec. 3.5).  From rest it is the loop of `yawrate_env.loop.closed_loop`.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.compiled import LANES, kernel, over_blocks
from yawrate_env.loop import controller
from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.feedback import delays
from yawrate_env.loop.target import Target

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class DriveState:
    """What a drive carries from one window to the next, for B vehicles.

    Attributes
    ----------
    x : NDArray
        (B, n) states of the vehicles, in the coordinates of their discrete plants; without dead
        time those of eqs. (6) to (9), which go on when friction, mass or speed change.
    late : NDArray
        (B, 1 + d) steering on its way to the plant, that of the next sample first [rad].
    u, e : NDArray
        (B,) last command [rad] and control error [rad/s].
    """

    x: Array
    late: Array
    u: Array
    e: Array

    @classmethod
    def rest(cls, plant: DiscretePlant, target: Target) -> Self:
        """Straight driving, with the steering at zero."""
        count, n = plant.B.shape
        late = np.zeros((count, 1 + int(delays(plant, target.delay_samples).max(initial=0))))
        return cls(np.zeros((count, n)), late, np.zeros(count), np.zeros(count))

    def __len__(self) -> int:
        return len(self.x)


def drive(
    plant: DiscretePlant,
    gains: Array,
    target: Target,
    reference: Array,
    disturbance: Array | None = None,
    noise: Array | None = None,
    state: DriveState | None = None,
) -> tuple[Array, Array, DriveState]:
    """Drive one window of N samples.

    Parameters
    ----------
    plant : DiscretePlant
        B vehicles at the controller's sampling time.
    gains : (B, 2) float64
        kp and Ti [s].
    target : Target
        The controller's sampling time, form and computation delay.
    reference : (1, N) or (B, N) float64
        Yaw-rate reference [rad/s].
    disturbance : (1, N) or (B, N) float64, optional
        Added to the command behind the computation delay, unseen by the logger [rad].
    noise : (1, N) or (B, N) float64, optional
        Of the gyro [rad/s].
    state : DriveState, optional
        Where the window before ended; rest if omitted.

    Returns
    -------
    u, y : (B, N) float64
        Command [rad] and measured yaw rate [rad/s], as logged.
    state : DriveState
        At the end of the window.
    """
    validation.number("plant.Ts", plant.Ts, at_least=target.Ts, at_most=target.Ts,
                      remedy="Discretise the vehicles at the controller's Ts.")  # fmt: skip
    count = len(plant)
    if gains.shape != (count, 2):
        raise ValueError(f"gains has shape {gains.shape}. Give ({count}, 2).")
    N = reference.shape[-1]
    quiet = np.zeros((1, N))
    signals = [
        _rows(name, signal, count, N)
        for name, signal in (
            ("reference", reference),
            ("disturbance", quiet if disturbance is None else disturbance),
            ("noise", quiet if noise is None else noise),
        )
    ]
    start = DriveState.rest(plant, target) if state is None else state
    work, ways = _packed(plant, gains, target, start)
    u, y = np.empty((count, N)), np.empty((count, N))
    n, late = plant.B.shape[1], start.late.shape[1]

    def one_block(i: int, j: int) -> None:
        lanes = np.minimum(np.arange(i, i + LANES), j - 1)
        block = np.ascontiguousarray(work[lanes].T)
        own = [lanes if len(signal) > 1 else np.zeros_like(lanes) for signal in signals]
        way = np.ascontiguousarray(ways[lanes].T)
        _recursion(n)(block.reshape(-1), way, late, plant.C, *signals, *own, u[i:j], y[i:j])
        work[i:j] = block[:, : j - i].T

    over_blocks(one_block, count, LANES)
    return u, y, _unpacked(work, n, late)


def _rows(name: str, signal: Array, count: int, N: int) -> Array:
    """A signal as (1 or B, N); the compiled loop does not check its indices."""
    rows = np.ascontiguousarray(np.atleast_2d(signal), dtype=np.float64)
    if rows.shape not in ((1, N), (count, N)):
        raise ValueError(f"{name} has shape {np.shape(signal)}. Give (1, {N}) or ({count}, {N}).")
    return rows


# Rows of the workspace, one number a lane: A, B, D, the controller's three coefficients, the
# state x and its next value, u, e, and the steering on its way.


def _packed(
    plant: DiscretePlant, gains: Array, target: Target, state: DriveState
) -> tuple[Array, NDArray[np.int64]]:
    """Workspace rows (B, rows), and where command and disturbance join the delay line (B, 2)."""
    n1, n0, d0 = controller.coefficients(gains[:, 0], gains[:, 1], target)
    n, delay = plant.B.shape[1], delays(plant, target.delay_samples)
    wanted = (len(plant), n), (len(plant), 1 + int(delay.max(initial=0)))
    if (state.x.shape, state.late.shape) != wanted:
        raise ValueError(
            f"state has shapes {state.x.shape} and {state.late.shape} of x and late, where these "
            f"vehicles have {wanted[0]} and {wanted[1]}. Begin from DriveState.rest."
        )
    zero = np.zeros(len(plant))
    D = zero if plant.D is None else plant.D
    scalars = np.stack([D, n1, n0 * target.Ts, 1 - d0 * target.Ts], axis=1)
    parts = [plant.A.reshape(len(plant), -1), plant.B, scalars, state.x, np.zeros_like(state.x),
             state.u[:, None], state.e[:, None], state.late]  # fmt: skip
    dead = np.zeros(len(plant), np.int64) if plant.delay is None else plant.delay
    return np.concatenate(parts, axis=1), np.stack([delay, dead], axis=1)


def _unpacked(work: Array, n: int, late: int) -> DriveState:
    at = n * n + n + 4
    u, e = work[:, -late - 2], work[:, -late - 1]
    return DriveState(work[:, at : at + n].copy(), work[:, -late:].copy(), u.copy(), e.copy())


@cache
def _recursion(n: int) -> Any:
    """Compile for order `n`, known to the compiler so that it unrolls the sums."""
    INPUT = n * n * LANES
    THROUGH, PROPORTIONAL, INTEGRAL, KEPT = (INPUT + (n + i) * LANES for i in range(4))
    STATE = KEPT + LANES
    NEXT = STATE + n * LANES
    COMMAND = NEXT + n * LANES
    ERROR, LATE = COMMAND + LANES, COMMAND + 2 * LANES

    @kernel
    def recursion(
        work: NDArray[np.float64],
        way: NDArray[np.int64],
        late: int,
        C: NDArray[np.float64],
        reference: NDArray[np.float64],
        disturbance: NDArray[np.float64],
        noise: NDArray[np.float64],
        own_reference: NDArray[np.int64],
        own_disturbance: NDArray[np.int64],
        own_noise: NDArray[np.int64],
        u: NDArray[np.float64],
        y: NDArray[np.float64],
    ) -> None:
        measured = np.empty(LANES)
        error = np.empty(LANES)
        for k in range(u.shape[1]):
            for lane in range(LANES):
                measured[lane] = noise[own_noise[lane], k]
                error[lane] = reference[own_reference[lane], k]
            for lane in range(LANES):
                output = work[THROUGH + lane] * work[LATE + lane]
                for i in range(n):
                    output += C[i] * work[STATE + i * LANES + lane]
                measured[lane] += output
                e = error[lane] - measured[lane]
                before = work[ERROR + lane]
                command = work[KEPT + lane] * work[COMMAND + lane]
                command += work[PROPORTIONAL + lane] * (e - before)
                command += work[INTEGRAL + lane] * before
                work[COMMAND + lane], work[ERROR + lane] = command, e
            for lane in range(LANES):
                work[LATE + way[0, lane] * LANES + lane] += work[COMMAND + lane]
                push = disturbance[own_disturbance[lane], k]
                work[LATE + way[1, lane] * LANES + lane] += push
            for lane in range(LANES):
                acting = work[LATE + lane]
                for i in range(n):
                    total = work[INPUT + i * LANES + lane] * acting
                    for j in range(n):
                        at = (i * n + j) * LANES + lane
                        total += work[at] * work[STATE + j * LANES + lane]
                    work[NEXT + i * LANES + lane] = total
            for i in range(n * LANES):
                work[STATE + i] = work[NEXT + i]
            for i in range((late - 1) * LANES):
                work[LATE + i] = work[LATE + i + LANES]
            for lane in range(LANES):
                work[LATE + (late - 1) * LANES + lane] = 0.0
            for lane in range(len(y)):
                y[lane, k], u[lane, k] = measured[lane], work[COMMAND + lane]

    return recursion
