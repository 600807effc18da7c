"""Two-stage tuners for any plant: a prior, a simulator and a design rule are enough.

``plants.Plant`` describes one, ``plants.train(plant)`` gives a tuner for it,
``plants.load(file)`` reads one back.  `docs/plants.md` is the guide.
"""

from tuners.plants.closed_loop import ClosedLoop, OpenLoop, Response
from tuners.plants.coordinates import LOG, Coordinates, loop
from tuners.plants.entry import find
from tuners.plants.figure import Figure
from tuners.plants.plant import Plant, snr
from tuners.plants.result import PlantFit, PlantResult
from tuners.plants.training import train
from tuners.plants.tuner import PlantTuner, load

__all__ = [
    "LOG",
    "ClosedLoop",
    "Coordinates",
    "Figure",
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
