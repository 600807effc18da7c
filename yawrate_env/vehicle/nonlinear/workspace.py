"""Memory layout of the kernel of `vehicle`: a row per quantity, a column per lane.

With one array the compiler sees that nothing overlaps and runs the lanes side by side.
"""

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.compiled import LANES
from yawrate_env.loop.discretisation import expm
from yawrate_env.vehicle.nonlinear.body import GRAVITY, Body
from yawrate_env.vehicle.nonlinear.steering import PIECE, PIECES, Limits
from yawrate_env.vehicle.nonlinear.tyre import Tyre, friction
from yawrate_env.vehicle.single_track import Context, Vehicle, constants, total_mass

_STEP = 0.08
"""Greatest step in units of the fastest time constant."""

_MOST_STEPS = 1000

# First the parameters that `packed` writes, an axle's six twice.
AXLE = 6
PEAK, FADE, STIFFNESS, NN, TRANSFER, LENGTH = range(AXLE)
REAR = AXLE
(
    PER_RELAX_F, PER_RELAX_R, PER_MASS, PER_INERTIA, PER_ROLL, DRAG, SPEED, SHAPE, CURVATURE,
    OMEGA, XI, ANGLE_MAX, RATE_MAX, STEP, STEPS,
) = range(2 * AXLE, 2 * AXLE + 15)  # fmt: skip
HALF = 2 * AXLE + 15  # the actuator over half a step and a whole one, 2 x 2 each
PARAMETERS = HALF + 8
# Then what changes: the state, that of a stage, and the sum of the slopes; the actuator's
# angle and rate, and the command; what a step passes on; and the step's pieces.
STATES = 6
STATE, STAGE, SUM = (PARAMETERS + i * STATES for i in range(3))
YAW_RATE, FORWARD = STATE + 1, STATE + 2
ANGLE, RATE, COMMAND = range(PARAMETERS + 3 * STATES, PARAMETERS + 3 * STATES + 3)
EXCESS, BEFORE, SPAN, SINE, COSINE = range(COMMAND + 1, COMMAND + 6)
CUTS = COSINE + 1
ROWS = CUTS + PIECES * PIECE


def packed(
    vehicle: Vehicle, tyre: Tyre, body: Body, limits: Limits, context: Context, Ts: float
) -> NDArray[np.float64]:
    """The workspace's columns of B vehicles at rest, (B, ROWS)."""
    mass = total_mass(vehicle, context)
    vehicle = constants(vehicle, context)
    work = np.zeros((len(context), ROWS))
    wheelbase = vehicle.l_f + vehicle.l_r
    load = mass / vehicle.M_0
    grip = friction(tyre, 2 * load)
    if len(mass):
        validation.number("friction of a wheel that carries its axle", grip.min(), above=0.0,
                          remedy="Lower M_delta or the tyre's friction_loss.")  # fmt: skip
    axles = (
        (0, vehicle.C_f, vehicle.l_f, vehicle.l_r, body.front_share),
        (REAR, vehicle.C_r, vehicle.l_r, vehicle.l_f, 1 - body.front_share),
    )
    for axle, stiffness, length, other, share in axles:
        weight = mass * GRAVITY * other / wheelbase
        work[:, axle + PEAK] = context.mu_s * friction(tyre, load) * weight
        work[:, axle + FADE] = tyre.friction_loss * load / friction(tyre, load)
        work[:, axle + STIFFNESS] = context.mu_s * stiffness
        work[:, axle + NN] = (load / tyre.stiffest_load) ** 2
        work[:, axle + TRANSFER] = 2 * share * mass * body.height / (body.track * weight)
        work[:, axle + LENGTH] = length
    work[:, PER_RELAX_F], work[:, PER_RELAX_R] = 1 / vehicle.l_rel_f, 1 / vehicle.l_rel_r
    work[:, PER_MASS], work[:, PER_INERTIA] = 1 / mass, 1 / vehicle.J_z
    work[:, PER_ROLL], work[:, DRAG] = 1 / body.roll_lag, body.drag
    work[:, SPEED] = work[:, FORWARD] = context.v_x
    work[:, SHAPE], work[:, CURVATURE] = tyre.shape, tyre.curvature
    work[:, OMEGA], work[:, XI] = vehicle.omega_n, vehicle.xi
    work[:, ANGLE_MAX], work[:, RATE_MAX] = limits.angle, limits.rate
    steps = np.ceil(Ts * _fastest(vehicle, body, context) / _STEP)
    if len(steps):
        validation.number("steps of integration a sample", steps.max(), at_most=_MOST_STEPS,
                          remedy="Shorten the sampling time, or soften the vehicle.")  # fmt: skip
    work[:, STEPS], work[:, STEP] = steps, Ts / steps
    actuator = np.zeros((len(context), 2, 2))
    actuator[:, 0, 1], actuator[:, 1, 0] = 1.0, -(vehicle.omega_n**2)
    actuator[:, 1, 1] = -2 * vehicle.xi * vehicle.omega_n
    halves = expm(actuator * work[:, STEP, None, None] / 2)
    work[:, HALF : HALF + 4] = halves.reshape(-1, 4)
    work[:, HALF + 4 : HALF + 8] = (halves @ halves).reshape(-1, 4)
    return work


def _fastest(vehicle: Vehicle, body: Body, context: Context) -> NDArray[np.float64]:
    """An upper estimate of the fastest dynamics, (B,) [1/s]."""
    v, mu_s, mass = context.v_x, context.mu_s, total_mass(vehicle, context)
    vehicle = constants(vehicle, context)
    rates = [np.full_like(v, r) for r in (vehicle.omega_n, 2 * vehicle.xi * vehicle.omega_n)]
    rates.append(np.full_like(v, 1 / body.roll_lag))
    for C, length, relax in (
        (vehicle.C_f * mu_s, vehicle.l_f, vehicle.l_rel_f),
        (vehicle.C_r * mu_s, vehicle.l_r, vehicle.l_rel_r),
    ):
        rates += [v / relax, np.sqrt(C * (1 / mass + length**2 / vehicle.J_z) / relax)]
    return np.asarray(np.max(rates, axis=0))


def block(columns: NDArray[np.float64], i: int, j: int) -> NDArray[np.float64]:
    """The flat workspace of vehicles i to j, padded to full lanes."""
    rows = np.minimum(np.arange(i, i + LANES), j - 1)
    return np.ascontiguousarray(columns[rows].T).reshape(-1)
