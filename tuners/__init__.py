"""One-shot controller tuners: a recorded episode in, PI gains out.

``tuners.load(name)`` gives one ready to use; ``tune(u, y, Ts)`` answers for one recording,
``predict(obs)`` acts as a policy in ``yawrate/PITuning-v0``.
"""

from gymnasium.envs.registration import register, registry

from tuners.catalogue import NAMES, RECIPES, load, train
from tuners.model_file import ModelFileError
from tuners.recording import Recording
from tuners.tuner import Tuner, TuningResult
from tuners.two_stage import Recipe, TwoStage

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

if "yawrate/PITuningFeatures-v0" not in registry:
    register(
        id="yawrate/PITuningFeatures-v0",
        entry_point="tuners.wrappers:features_env",
        vector_entry_point="tuners.wrappers:features_vector_env",
    )
