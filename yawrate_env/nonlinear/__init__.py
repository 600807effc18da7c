"""The nonlinear digital twin: the same vehicle beyond small angles."""

from yawrate_env.nonlinear.steering import Limits
from yawrate_env.nonlinear.twin import NonlinearTwin, twin_from
from yawrate_env.nonlinear.tyre import Tyre
from yawrate_env.nonlinear.vehicle import Body

__all__ = ["Body", "Limits", "NonlinearTwin", "Tyre", "twin_from"]
