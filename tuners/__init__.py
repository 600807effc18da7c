"""One-shot controller tuners: a recorded episode in, PI gains out.

``tuners.load(name)`` gives one ready to use; ``tune(u, y, Ts)`` answers for one recording,
``predict(obs)`` acts as a policy in ``yawrate/PITuning-v0``.  What the import registers is
in `yawrate_env`.
"""

from tuners.catalogue import NAMES, RECIPES, load, train
from tuners.model_file import ModelFileError
from tuners.recording import Recording
from tuners.result import TuningResult
from tuners.stages import Recipe
from tuners.tuner import Tuner
from tuners.two_stage import TwoStage

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
