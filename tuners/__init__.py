"""One-shot controller tuners: a recorded episode in, PI gains out.

``tuners.load(name)`` gives one ready to use; ``tune(u, y, Ts)`` answers for one recording,
``predict(obs)`` acts as a policy in ``yawrate/PITuning-v0``.  What the import registers is
in `yawrate_env`.
"""

from tuners.catalogue import NAMES, RECIPES, load, train
from tuners.tuner.recording import Recording
from tuners.tuner.result import TuningResult
from tuners.tuner.stages import Recipe
from tuners.tuner.tuner import Tuner
from tuners.tuner.tuner_file import ModelFileError
from tuners.tuner.two_stage import TwoStage

__all__ = [
    "NAMES",
    "RECIPES",
    "ModelFileError",
    "Recipe",
    "Recording",
    "Tuner",
    "TuningResult",
    "TwoStage",
    "load",
    "train",
]
