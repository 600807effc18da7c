r"""A recorded road-wheel angle instead of the command, turned into what the command would give.

The controller will act through the steering actuator ``G_a`` (eq. (9)), and a tuner expects
command to yaw rate, ``G_v G_a``.  A measured angle shows ``G_v`` alone.  Linear systems commute:

    G_a r = G_a G_v delta = (G_v G_a) delta,

so the measured angle taken as the command, and the yaw rate filtered through the known
actuator, are the input and output of the whole vehicle, exactly.  Both are continuous
signals: cubic splines bring them to a grid of a millisecond or finer, the filter takes the
yaw rate as linear between its points, and the angle that is held over a step is the one at
its middle, since a sample held would come half a step late.
"""

import numpy as np

from tuners.logs.table import Array
from yawrate_env.loop.discretisation import expm
from yawrate_env.vehicle.single_track import Vehicle

FINE = 0.001


def through_actuator(
    steer: Array, yaw_rate: Array, Ts: float, vehicle: Vehicle
) -> tuple[Array, Array, float, int]:
    """Command and yaw rate of the whole vehicle from a measured road-wheel angle.

    Parameters
    ----------
    steer, yaw_rate : (N,) float64
        Road-wheel angle [rad] and yaw rate [rad/s].
    Ts : float
        Sampling time [s].

    Returns
    -------
    command, filtered : (M,) float64
    Ts : float
        Of these [s].
    parts : int
        How many of their steps make one of the recording's.
    """
    from scipy.interpolate import CubicSpline

    parts = max(1, int(np.ceil(Ts / FINE - 1e-9)))
    fine, knots = Ts / parts, Ts * np.arange(len(steer))
    grid = fine * np.arange((len(steer) - 1) * parts)
    command = CubicSpline(knots, steer)(grid + fine / 2)
    output = CubicSpline(knots, yaw_rate)(grid)
    return command, actuated(output, fine, vehicle), fine, parts


def actuated(signal: Array, Ts: float, vehicle: Vehicle) -> Array:
    """Response (N,) of the actuator to a signal that is linear between its samples.

    It starts in the steady state of the first sample.
    """
    A = np.array([[0.0, 1.0], [-(vehicle.omega_n**2), -2 * vehicle.xi * vehicle.omega_n]])
    X = np.zeros((1, 4, 4))
    X[0, :2, :2], X[0, 1, 2], X[0, 2, 3] = A * Ts, vehicle.omega_n**2 * Ts, 1.0
    E = expm(X)[0]  # x+ = Ad x + b0 u + b1 (u+ - u): a first-order hold (Van Loan, 1978)
    (a, b), (c, d) = E[:2, :2].tolist()
    (h, g), (p, q) = E[0, 2:].tolist(), E[1, 2:].tolist()
    out = np.empty_like(signal)
    x, v = float(signal[0]), 0.0
    values = [*signal.tolist(), float(signal[-1])]
    for k in range(len(signal)):
        out[k] = x
        u, step = values[k], values[k + 1] - values[k]
        x, v = a * x + b * v + h * u + g * step, c * x + d * v + p * u + q * step
    return out
