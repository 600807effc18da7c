"""The closed loop in time: the sampled controller on the nonlinear vehicle, batched.

The controller is that of `yawrate_env.loop.closed_loop`, with its integrator w and its delay;
between its samples the vehicle is integrated with the command held.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.compiled import LANES, kernel, over_blocks
from yawrate_env.loop import controller
from yawrate_env.vehicle.manoeuvre import double_lane_change
from yawrate_env.vehicle.nonlinear.twin import NonlinearTwin
from yawrate_env.vehicle.nonlinear.vehicle import advance
from yawrate_env.vehicle.nonlinear.workspace import COMMAND, YAW_RATE, block, packed
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Task

SETTLED = 0.02
"""Settled means within this share of the step."""

_STEP_TIME = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class TimeDomain:
    """Time-domain metrics of B closed loops; arrays (B,).

    Attributes
    ----------
    overshoot : NDArray
        Of the step response, over the step [%].
    settling_time : NDArray
        After which the yaw rate stays within 2 % of the step [s]; ``nan`` where it is not
        settled after ten seconds.
    tracking_error : NDArray
        Root mean square error in the double lane change [rad/s].
    """

    overshoot: NDArray[np.float64]
    settling_time: NDArray[np.float64]
    tracking_error: NDArray[np.float64]


def time_domain(
    task: Task,
    context: Context,
    kp: NDArray[np.float64],
    Ti: NDArray[np.float64],
    yaw_rate: float = float(np.radians(5.0)),
) -> TimeDomain:
    """Loops gains (B,) by a step of the yaw rate and a double lane change.

    Parameters
    ----------
    task : Task
        With a `NonlinearTwin`.
    yaw_rate : float
        Height of the step and of the lane change's bends [rad/s].
    """
    Ts = task.target.Ts
    step = np.full(max(2, round(_STEP_TIME / Ts)), yaw_rate)
    y, _ = time_response(task, context, kp, Ti, step)
    outside = np.abs(y - yaw_rate) > SETTLED * abs(yaw_rate)
    last = y.shape[1] - 1 - outside[:, ::-1].argmax(axis=1)
    settling = np.where(outside.any(axis=1), (last + 1) * Ts, 0.0)
    _, bends = double_lane_change(Ts, yaw_rate)
    followed, _ = time_response(task, context, kp, Ti, bends)
    return TimeDomain(
        100 * np.maximum(y.max(axis=1) / yaw_rate - 1, 0.0),
        np.where(outside[:, -1], np.nan, settling),
        np.sqrt(np.mean((followed - bends) ** 2, axis=1)),
    )


def time_response(
    task: Task,
    context: Context,
    kp: NDArray[np.float64],
    Ti: NDArray[np.float64],
    reference: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Response from straight driving to a reference.

    Parameters
    ----------
    reference : (N,) float64
        Yaw-rate reference at the controller's sampling time [rad/s].

    Returns
    -------
    y, u : (B, N) float64
        Yaw rate [rad/s] and steering command, before the actuator's limits [rad].
    """
    target, remedy = task.target, "Linear ones have closed_loop.time_response."
    twin = validation.instance("task.twin", task.twin, NonlinearTwin, remedy=remedy)
    columns = packed(task.vehicle, twin.tyre, twin.body, twin.limits, context, target.Ts)
    coefficients = np.stack(controller.coefficients(kp, Ti, target))
    y, u = (np.empty((len(context), len(reference))) for _ in range(2))

    def drive(i: int, j: int) -> None:
        lanes = np.minimum(np.arange(i, i + LANES), j - 1)
        _drive(
            block(columns, i, j),
            np.ascontiguousarray(coefficients[:, lanes]),
            target.Ts,
            np.zeros((target.delay_samples + 1, LANES)),
            reference,
            y[i:j],
            u[i:j],
        )

    over_blocks(drive, len(context), LANES)
    return y, u


@kernel
def _drive(
    work: NDArray[np.float64],
    coefficients: NDArray[np.float64],
    Ts: float,
    commands: NDArray[np.float64],
    reference: NDArray[np.float64],
    y: NDArray[np.float64],
    u: NDArray[np.float64],
) -> None:
    """Close the loops of a block; `commands` holds those on their way, newest first."""
    n1, n0, d0 = coefficients
    w = np.zeros(LANES)
    for k in range(len(reference)):
        for late in range(len(commands) - 1, 0, -1):
            commands[late] = commands[late - 1]
        for lane in range(LANES):
            rate = work[YAW_RATE * LANES + lane]
            e = reference[k] - rate
            commands[0, lane] = n1[lane] * e + (n0[lane] - d0[lane] * n1[lane]) * w[lane]
            w[lane] += Ts * (e - d0[lane] * w[lane])
            work[COMMAND * LANES + lane] = commands[len(commands) - 1, lane]
            if lane < len(y):
                y[lane, k], u[lane, k] = rate, commands[0, lane]
        advance(work)
