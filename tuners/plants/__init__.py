"""Two-stage tuners for any plant: a prior, a simulator and a design rule are enough.

``plants.Plant`` describes one, ``plants.train(plant)`` gives a tuner for it,
``plants.load(file)`` reads one back.  `docs/plants.md` is the guide.
"""

from tuners.tuner.plant_result import PlantFit, PlantResult
from tuners.tuner.plant_tuner import PlantTuner, load
from tuners.tuner.training import train
from yawrate_env.plant.entry import find
from yawrate_env.plant.metric import Metric
from yawrate_env.plant.parametrisation import LOG, Coordinates, loop
from yawrate_env.plant.plant import Plant, snr
from yawrate_env.plant.responses import ClosedLoop, OpenLoop, Response

__all__ = [
    "LOG",
    "ClosedLoop",
    "Coordinates",
    "Metric",
    "OpenLoop",
    "Plant",
    "PlantFit",
    "PlantResult",
    "PlantTuner",
    "Response",
    "find",
    "load",
    "loop",
    "snr",
    "train",
]
