r"""A measured actuator position instead of its command, turned into what the command would give.

The controller acts through the plant's actuator ``G_a``, and a tuner expects command to output,
``G G_a``.  A measured position ``d`` shows ``G`` alone.  Linear systems commute:

    G_a y = G_a G d = (G G_a) d,

so the measured position taken as the command, and the output filtered through the known
actuator, are the input and output of the whole plant, exactly.  Both are continuous signals:
cubic splines bring them to a grid of a millisecond or finer, the filter takes the output as
linear between its points, and the position that is held over a step is the one at its middle,
since a sample held would come half a step late.
"""

import numpy as np

from tuners.logs.table import Array, SelectionError
from yawrate_env.plant.plant import Plant

FINE = 0.001


def through_actuator(
    u: Array, y: Array, Ts: float, plant: Plant
) -> tuple[Array, Array, float, int]:
    """Input and output of the whole plant from a measured actuator position.

    Parameters
    ----------
    u, y : (N,) float64
        Actuator position and output.
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

    if plant.actuator is None:
        raise SelectionError("input_is = measured: this plant has no known actuator.")
    parts = max(1, int(np.ceil(Ts / FINE - 1e-9)))
    fine, knots = Ts / parts, Ts * np.arange(len(u))
    grid = fine * np.arange((len(u) - 1) * parts)
    command = CubicSpline(knots, u)(grid + fine / 2)
    filtered = plant.actuator(CubicSpline(knots, y)(grid), fine)
    return command, filtered, fine, parts
