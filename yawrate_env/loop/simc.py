"""SIMC rules for PI controllers, in closed form.

Skogestad, "Simple analytic rules for model reduction and PID controller tuning", Journal of Process
Control 13, 2003.  With a wanted time constant ``tau_c`` of the closed loop, by default the dead
time ("tight"),

===========================  ========================  ==========================
plant                        kp                        Ti
===========================  ========================  ==========================
K e^{-Ls}/(T s + 1)          T / (K (tau_c + L))       min(T, 4 (tau_c + L))
K e^{-Ls}/s                  1 / (K (tau_c + L))       4 (tau_c + L)
===========================  ========================  ==========================

Of two lags the half rule makes one: half of the smaller goes to the other, half to the dead time.
A digital controller's hold adds half a sampling time to L.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def simc(gain: Array, lag: Array, dead_time: Array, tau_c: float | Array | None = None) -> Array:
    """Gains (kp, Ti), (B, 2), of first-order plants; a lag of ``inf`` is an integrator.

    Parameters
    ----------
    gain : (B,) float64
        Steady gain K, or the slope K/T [1/s] for ``lag = inf``.
    lag, dead_time : (B,) float64
        T and L, the hold's half sample in it [s].
    tau_c : float or (B,) float64, optional
        Wanted time constant of the closed loop [s].
    """
    slow = (dead_time if tau_c is None else tau_c) + dead_time
    slope = np.where(np.isinf(lag), gain, gain / lag)
    return np.stack([1 / (slope * slow), np.minimum(lag, 4 * slow)], axis=1)


def half_rule(one: Array, other: Array, dead_time: Array) -> tuple[Array, Array]:
    """Lag and dead time, (B,) each, of two lags (B,) behind a dead time."""
    large, small = np.maximum(one, other), np.minimum(one, other)
    return large + small / 2, dead_time + small / 2
