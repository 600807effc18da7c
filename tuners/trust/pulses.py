"""Pulse responses of a black box's functions, as a controller's samples see them."""

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre import Laguerre
from yawrate_env.loop.target import Target
from yawrate_env.plant.pi_loop import pulse_samples

Array = NDArray[np.float64]

_WHOLE = 1e-6  # of a sampling time


def pulses_of(functions: Laguerre, Ts: float, target: Target) -> Array | None:
    """Outputs (n, K) of the functions for an input of one during the controller's first sample.

    None where a recording's samples, `Ts` [s] apart, are no whole parts of the controller's.
    """
    hold, parts = target.Ts, round(target.Ts / Ts)
    if parts < 1 or abs(parts * Ts - hold) > _WHOLE * hold:
        return None
    held = np.zeros((1, parts * pulse_samples(target)))
    held[0, :parts] = 1.0
    each = np.eye(functions.order)[None]
    return np.ascontiguousarray(functions.outputs(held, each, Ts)[0, :, ::parts])
