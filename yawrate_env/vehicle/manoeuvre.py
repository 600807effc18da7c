"""Yaw-rate references for closed loops."""

import numpy as np
from numpy.typing import NDArray


def double_lane_change(
    Ts: float, yaw_rate: float = float(np.radians(5.0))
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two lane changes in ten seconds with driver-like ramps.

    Parameters
    ----------
    Ts : float
        Sampling time [s].
    yaw_rate : float
        Of the bends [rad/s].

    Returns
    -------
    time, reference : (N,) float64
        [s] and [rad/s].
    """
    time = np.arange(0.0, 10.0, Ts)
    corners = [0.0, 1.0, 1.3, 2.7, 3.3, 4.7, 5.3, 6.7, 7.0, 10.0]
    bends = [0.0, 0.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0, 0.0, 0.0]
    return time, yaw_rate * np.interp(time, corners, bends)
