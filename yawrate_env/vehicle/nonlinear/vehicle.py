"""The single-track vehicle on saturating tyres, and one sample of it in compiled form.

State ``x = [v_y, r, v_x, a_f, a_r, q]`` behind the actuator of `steering`:

    M (v_y' + v_x r) = F_f cos(delta) + F_r
    J_z r'           = l_f F_f cos(delta) - l_r F_r
    M (v_x' - v_y r) = -F_f sin(delta) - drag (v_x |v_x| - v_0^2)
    l_rel_f a_f'     = V_f - |U_f| a_f,   F_f = -axle_f(a_f, q)
    l_rel_r a_r'     = v_y - l_r r - |v_x| a_r,   F_r = -axle_r(a_r, q)
    roll_lag q'      = (F_f cos(delta) + F_r) / M - q

``(U_f, V_f)`` is the front axle's velocity along and across its wheels, ``a`` the lagged
tangent of the slip angle (Pacejka, chapter 7), which stays finite when the
vehicle turns round; the drive force holds the speed v_0 when driving straight, so that
cornering costs speed; q is the lateral acceleration as the roll passes it on to the
wheel loads.  About straight driving, with ``beta = v_y / v_0``, these are eqs. (6) to
(9): speed and load transfer are of second order.

Integration: the classical Runge-Kutta method of order four.  One step a sample of 1 ms
leaves 1e-9 rad/s at 20 m/s and 4 degrees against ``solve_ivp`` at 1e-12, on any friction,
and 4e-9 at most between 10 and 33 m/s.  An exponential integrator was left aside: the
stiffest parts, tyre lag and actuator, have time constants of about twenty steps, so
that exact linear parts would save nothing, and at 4 degrees the tyres' slope changes by
its whole size.  The actuator is exact (`steering`), and steps are cut where its limits
begin and end to act, so that no step meets a kink.  (One is left: a wheel that lifts,
beyond 1.3 g with the default body.)
"""

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import LANES, kernel
from yawrate_env.vehicle.nonlinear.steering import PIECE, PIECES, cut
from yawrate_env.vehicle.nonlinear.tyre import axle_force, sine
from yawrate_env.vehicle.nonlinear.workspace import (
    ANGLE,
    ANGLE_MAX,
    BEFORE,
    COMMAND,
    COSINE,
    CURVATURE,
    CUTS,
    DRAG,
    EXCESS,
    FADE,
    HALF,
    LENGTH,
    NN,
    OMEGA,
    PEAK,
    PER_INERTIA,
    PER_MASS,
    PER_RELAX_F,
    PER_RELAX_R,
    PER_ROLL,
    RATE,
    RATE_MAX,
    REAR,
    SHAPE,
    SINE,
    SPAN,
    SPEED,
    STAGE,
    STATE,
    STATES,
    STEP,
    STEPS,
    STIFFNESS,
    SUM,
    TRANSFER,
    XI,
)


@kernel
def advance(work: NDArray[np.float64]) -> None:
    """Move every lane by one sample with its command held."""
    most = 0.0
    for lane in range(LANES):
        most = max(most, work[STEPS * LANES + lane])
    for step in range(int(most)):
        for piece in range(_steer(work, step)):
            _runge_kutta(work, CUTS + PIECE * piece)


@kernel
def _steer(work: NDArray[np.float64], step: int) -> int:
    """Move the actuators by one step and write its pieces; return how many count.

    A lane that takes fewer steps than others stands still when its own are done.
    """
    for lane in range(LANES):
        angle, rate = work[ANGLE * LANES + lane], work[RATE * LANES + lane]
        bound = work[ANGLE_MAX * LANES + lane]
        command = max(-bound, min(bound, work[COMMAND * LANES + lane]))
        omega, twice_xi = work[OMEGA * LANES + lane], 2.0 * work[XI * LANES + lane]
        moves = step < work[STEPS * LANES + lane]
        h = work[STEP * LANES + lane]
        e = angle - command
        middle = work[HALF * LANES + lane] * e + work[(HALF + 1) * LANES + lane] * rate
        end = work[(HALF + 4) * LANES + lane] * e + work[(HALF + 5) * LANES + lane] * rate
        free = work[(HALF + 6) * LANES + lane] * e + work[(HALF + 7) * LANES + lane] * rate
        # Within the step the rate exceeds its ends by no more than their slopes reach.
        before = abs(rate) + h * omega * abs(omega * e + twice_xi * rate)
        after = abs(free) + h * omega * abs(omega * end + twice_xi * free)
        excess = max(before, after) - work[RATE_MAX * LANES + lane]
        work[EXCESS * LANES + lane] = excess if moves else -1.0
        work[BEFORE * LANES + lane] = rate
        work[CUTS * LANES + lane] = h if moves else 0.0
        work[(CUTS + 1) * LANES + lane] = angle
        work[(CUTS + 2) * LANES + lane] = command + middle
        work[(CUTS + 3) * LANES + lane] = command + end
        work[ANGLE * LANES + lane] = command + end if moves else angle
        work[RATE * LANES + lane] = free if moves else rate
    worst = -1.0
    for lane in range(LANES):
        worst = max(worst, work[EXCESS * LANES + lane])
    return _limited(work) if worst >= 0.0 else 1


@kernel
def _limited(work: NDArray[np.float64]) -> int:
    """Cut the step of the lanes whose rate may meet its limit; return the most pieces."""
    used = 1
    pieces = np.empty((PIECES, PIECE))
    for lane in range(LANES):
        for piece in range(1, PIECES):
            work[(CUTS + PIECE * piece) * LANES + lane] = 0.0
        if work[EXCESS * LANES + lane] >= 0.0:
            bound = work[ANGLE_MAX * LANES + lane]
            work[RATE * LANES + lane] = cut(
                work[(CUTS + 1) * LANES + lane],
                work[BEFORE * LANES + lane],
                max(-bound, min(bound, work[COMMAND * LANES + lane])),
                work[STEP * LANES + lane],
                work[OMEGA * LANES + lane],
                work[XI * LANES + lane],
                work[RATE_MAX * LANES + lane],
                pieces,
            )
            for piece in range(PIECES):
                used = max(used, piece + 1 if pieces[piece, 0] > 0.0 else 1)
                for i in range(PIECE):
                    work[(CUTS + PIECE * piece + i) * LANES + lane] = pieces[piece, i]
            work[ANGLE * LANES + lane] = pieces[PIECES - 1, 3]
    return used


@kernel
def _runge_kutta(work: NDArray[np.float64], piece: int) -> None:
    """Move the vehicles over the piece in this row; over one without length, not at all."""
    for i in range(STATES * LANES):
        work[STAGE * LANES + i] = work[SUM * LANES + i] = work[STATE * LANES + i]
    for lane in range(LANES):
        work[SPAN * LANES + lane] = work[piece * LANES + lane]
    for stage in range(4):
        reach = 0.5 if stage < 2 else 1.0
        weight = 1.0 / 3.0 if stage in (1, 2) else 1.0 / 6.0
        if stage != 2:  # the two in the middle see the same wheel
            _turn(work, piece + 1 + (stage + 1) // 2)
        _stage(work, reach, weight)
    for i in range(STATES * LANES):
        work[STATE * LANES + i] = work[SUM * LANES + i]


@kernel
def _turn(work: NDArray[np.float64], row: int) -> None:
    """Sine and cosine of the wheel angles in this row."""
    for lane in range(LANES):
        work[SINE * LANES + lane] = work[row * LANES + lane]
    for lane in range(LANES):
        angle = work[SINE * LANES + lane]
        work[SINE * LANES + lane] = sine(angle)
        work[COSINE * LANES + lane] = sine(0.5 * np.pi - angle)


@kernel
def _stage(work: NDArray[np.float64], reach: float, weight: float) -> None:
    """Slopes at the stage's state: on to the next stage's, and into the weighted sum."""
    for lane in range(LANES):
        v_y = work[STAGE * LANES + lane]
        r = work[(STAGE + 1) * LANES + lane]
        v_x = work[(STAGE + 2) * LANES + lane]
        a_f = work[(STAGE + 3) * LANES + lane]
        a_r = work[(STAGE + 4) * LANES + lane]
        q = work[(STAGE + 5) * LANES + lane]
        shape, curvature = work[SHAPE * LANES + lane], work[CURVATURE * LANES + lane]
        x = work[TRANSFER * LANES + lane] * q
        F_f = -axle_force(
            a_f,
            min(x * x, 1.0),
            work[STIFFNESS * LANES + lane],
            work[PEAK * LANES + lane],
            work[FADE * LANES + lane],
            work[NN * LANES + lane],
            shape,
            curvature,
        )
        x = work[(REAR + TRANSFER) * LANES + lane] * q
        F_r = -axle_force(
            a_r,
            min(x * x, 1.0),
            work[(REAR + STIFFNESS) * LANES + lane],
            work[(REAR + PEAK) * LANES + lane],
            work[(REAR + FADE) * LANES + lane],
            work[(REAR + NN) * LANES + lane],
            shape,
            curvature,
        )
        per_mass = work[PER_MASS * LANES + lane]
        l_f, l_r = work[LENGTH * LANES + lane], work[(REAR + LENGTH) * LANES + lane]
        sin, cos = work[SINE * LANES + lane], work[COSINE * LANES + lane]
        lateral = (F_f * cos + F_r) * per_mass
        v_0 = work[SPEED * LANES + lane]
        braking = F_f * sin + work[DRAG * LANES + lane] * (v_x * abs(v_x) - v_0 * v_0)
        across = v_y + l_f * r
        slip_f = across * cos - v_x * sin - abs(v_x * cos + across * sin) * a_f
        slip_r = v_y - l_r * r - abs(v_x) * a_r
        dv_y = lateral - v_x * r
        dr = (l_f * F_f * cos - l_r * F_r) * work[PER_INERTIA * LANES + lane]
        dv_x = v_y * r - braking * per_mass
        da_f = slip_f * work[PER_RELAX_F * LANES + lane]
        da_r = slip_r * work[PER_RELAX_R * LANES + lane]
        dq = (lateral - q) * work[PER_ROLL * LANES + lane]
        h = work[SPAN * LANES + lane]
        part, step = weight * h, reach * h
        work[SUM * LANES + lane] += part * dv_y
        work[(SUM + 1) * LANES + lane] += part * dr
        work[(SUM + 2) * LANES + lane] += part * dv_x
        work[(SUM + 3) * LANES + lane] += part * da_f
        work[(SUM + 4) * LANES + lane] += part * da_r
        work[(SUM + 5) * LANES + lane] += part * dq
        work[STAGE * LANES + lane] = work[STATE * LANES + lane] + step * dv_y
        work[(STAGE + 1) * LANES + lane] = work[(STATE + 1) * LANES + lane] + step * dr
        work[(STAGE + 2) * LANES + lane] = work[(STATE + 2) * LANES + lane] + step * dv_x
        work[(STAGE + 3) * LANES + lane] = work[(STATE + 3) * LANES + lane] + step * da_f
        work[(STAGE + 4) * LANES + lane] = work[(STATE + 4) * LANES + lane] + step * da_r
        work[(STAGE + 5) * LANES + lane] = work[(STATE + 5) * LANES + lane] + step * dq
