"""`Plant`: a prior over parameters, a simulator, a design rule and the metrics of its loop.

Random episodes, rewards and entry points belong to it.  What is special about one plant does not
belong here, nor does anything that learns.
"""

from yawrate_env.plant.distributions import LogRange, Normal
from yawrate_env.plant.metric import Metric
from yawrate_env.plant.noise import snr
from yawrate_env.plant.parametrisation import GAINS, LOG, Parametrisation, loop
from yawrate_env.plant.plant import Plant
from yawrate_env.plant.responses import ClosedLoop, OpenLoop, Response

__all__ = [
    "GAINS",
    "LOG",
    "ClosedLoop",
    "LogRange",
    "Metric",
    "Normal",
    "OpenLoop",
    "Parametrisation",
    "Plant",
    "Response",
    "loop",
    "snr",
]
