"""Yaw-rate references for closed loops.

Those of `step`, `lane_change` and `weave` are batched: parameters are numbers or (B,) arrays, and
references (B, N), with B = 1 where all are numbers.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def step(
    time: Array, yaw_rate: ArrayLike, start: ArrayLike, ramp: ArrayLike, length: ArrayLike
) -> Array:
    """A bend: up, held, and back to straight driving.

    Parameters
    ----------
    time : (N,) float64
        [s].
    yaw_rate : float or (B,)
        Of the bend [rad/s].
    start, ramp, length : float or (B,)
        When it begins, how long the yaw rate takes to rise or to fall (zero for a step), and from
        the one to the other [s].
    """
    height, begin, rise, held = _columns(yaw_rate, start, ramp, length)
    slope = np.maximum(rise, 1e-12)
    up = np.clip((time - begin) / slope, 0.0, 1.0)
    down = np.clip((time - begin - held) / slope, 0.0, 1.0)
    return np.asarray(height * (up - down))


def lane_change(time: Array, yaw_rate: ArrayLike, start: ArrayLike, length: ArrayLike) -> Array:
    """One period of a sine: out of the lane, and along it again.

    Parameters
    ----------
    yaw_rate : float or (B,)
        Amplitude [rad/s].
    start, length : float or (B,)
        When it begins, and how long it takes [s].
    """
    height, begin, period = _columns(yaw_rate, start, length)
    phase = np.clip((time - begin) / period, 0.0, 1.0)
    return np.asarray(height * np.sin(2 * np.pi * phase))


def weave(time: Array, yaw_rate: ArrayLike, frequency: ArrayLike, phase: ArrayLike) -> Array:
    """A sine of amplitude `yaw_rate` [rad/s], frequency [Hz] and phase [rad]."""
    height, pace, begin = _columns(yaw_rate, frequency, phase)
    return np.asarray(height * np.sin(2 * np.pi * pace * time + begin))


def double_lane_change(Ts: float, yaw_rate: float = float(np.radians(5.0))) -> tuple[Array, Array]:
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


def _columns(*values: ArrayLike) -> list[Array]:
    """Parameters as (B, 1)."""
    columns = (np.atleast_1d(np.asarray(value, dtype=np.float64))[:, None] for value in values)
    return list(columns)
