"""Tune a yaw-rate controller from one recorded episode: a Gymnasium environment.

``import yawrate_env`` registers ``yawrate/PITuning-v0``, the same on a nonlinear vehicle as
``yawrate/PITuningNonlinear-v0``, re-calibration while friction changes as
``yawrate/PIRecalibration-v0``, any plant of one's own as ``yawrate/Plant-v0``, and, ready
to train on, ``yawrate/PITuningFeatures-v0`` and ``yawrate/PlantFeatures-v0``, which are in
`tuners`.  Entry points are strings, so that the import itself stays light.

The package holds plants, their loops and the environments; nothing that learns belongs here.
"""

from gymnasium.envs.registration import register, registry

__version__ = "0.2.0"

ENV_ID = "yawrate/PITuning-v0"
NONLINEAR_ID = "yawrate/PITuningNonlinear-v0"
FEATURES_ID = "yawrate/PITuningFeatures-v0"
PLANT_ID = "yawrate/Plant-v0"
PLANT_FEATURES_ID = "yawrate/PlantFeatures-v0"
RECALIBRATION_ID = "yawrate/PIRecalibration-v0"

_VEHICLE, _FEATURES = "yawrate_env.env.yaw_rate_env", "tuners.agents.wrappers"
_RECALIBRATION = "yawrate_env.env.recalibration_env"

_ENTRY_POINTS = {
    ENV_ID: (f"{_VEHICLE}:PITuningEnv", f"{_VEHICLE}:PITuningVectorEnv"),
    NONLINEAR_ID: (f"{_VEHICLE}:PITuningNonlinearEnv", f"{_VEHICLE}:PITuningNonlinearVectorEnv"),
    FEATURES_ID: (f"{_FEATURES}:features_env", f"{_FEATURES}:features_vector_env"),
    PLANT_ID: (
        "yawrate_env.env.tuning_env:plant_env",
        "yawrate_env.env.vector_env:plant_vector_env",
    ),
    PLANT_FEATURES_ID: (
        f"{_FEATURES}:plant_features_env",
        f"{_FEATURES}:plant_features_vector_env",
    ),
    RECALIBRATION_ID: (
        f"{_RECALIBRATION}:PIRecalibrationEnv",
        f"{_RECALIBRATION}:PIRecalibrationVectorEnv",
    ),
}

for _id, (_scalar, _vector) in _ENTRY_POINTS.items():
    if _id not in registry:
        register(id=_id, entry_point=_scalar, vector_entry_point=_vector)
