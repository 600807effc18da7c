"""The nonlinear digital twin: the same vehicle beyond small angles.

Tyres, steering limits, body and their compiled integration.  Control loops and the linear
vehicle, about which loops are evaluated, do not belong here.
"""

from yawrate_env.vehicle.nonlinear.body import Body
from yawrate_env.vehicle.nonlinear.steering import Limits
from yawrate_env.vehicle.nonlinear.twin import NonlinearTwin
from yawrate_env.vehicle.nonlinear.tyre import Tyre

__all__ = ["Body", "Limits", "NonlinearTwin", "Tyre"]
