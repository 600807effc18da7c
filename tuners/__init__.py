"""One-shot controller tuners: a recorded episode in, gains out.

``tuners.load(name or file)`` gives a tuner ready to use, ``tuners.train(name, recipe or plant)``
trains one; ``tune(u, y, Ts)`` answers for one recording, ``predict(obs)`` acts as a policy in the
plant's environment.  The plants and environments are in `yawrate_env`.
"""

from tuners.catalogue import NAMES, RECIPES, load, train
from tuners.tuner.recording import Recording
from tuners.tuner.result import Result
from tuners.tuner.schedule import Schedule, schedule
from tuners.tuner.stages import Recipe
from tuners.tuner.tuner import Tuner
from tuners.tuner.tuner_file import TunerFileError
from yawrate_env.plant.metric import Metric
from yawrate_env.plant.parameters import LogRange, Normal
from yawrate_env.plant.parametrisation import Parametrisation
from yawrate_env.plant.plant import Plant

__all__ = [
    "NAMES",
    "RECIPES",
    "LogRange",
    "Metric",
    "Normal",
    "Parametrisation",
    "Plant",
    "Recipe",
    "Recording",
    "Result",
    "Schedule",
    "Tuner",
    "TunerFileError",
    "load",
    "schedule",
    "train",
]
