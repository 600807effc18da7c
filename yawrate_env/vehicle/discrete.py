"""The linear vehicle at the samples, dead time and sensor lag included."""

import numpy as np

from yawrate_env.loop.dead_time import zoh_late
from yawrate_env.loop.discretisation import DiscretePlant, zoh
from yawrate_env.vehicle.single_track import Context, Vehicle, constants, has, state_space


def plants(vehicle: Vehicle, context: Context, Ts: float) -> DiscretePlant:
    """ZOH plants of the batch at `Ts` [s], from steering command to measured yaw rate."""
    matrices = state_space(vehicle, context)
    if not has(vehicle, context, "dead_time"):
        return zoh(*matrices, Ts)
    dead_time = constants(vehicle, context).dead_time
    return zoh_late(*matrices, Ts, np.broadcast_to(dead_time, len(context)).astype(np.float64))
