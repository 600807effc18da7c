"""Tune a yaw-rate controller from one recorded episode: a Gymnasium environment.

``import yawrate_env`` registers ``yawrate/PITuning-v0``, the same on a nonlinear vehicle as
``yawrate/PITuningNonlinear-v0``, any plant of one's own as ``yawrate/Plant-v0``, and, ready
to train on, ``yawrate/PITuningFeatures-v0`` and ``yawrate/PlantFeatures-v0``.  What needs
`tuners` is imported from there; all modules are imported where they are used, so that the
import itself stays light.
"""

from gymnasium.envs.registration import register, registry

__version__ = "0.1.0"

ENV_ID = "yawrate/PITuning-v0"
NONLINEAR_ID = "yawrate/PITuningNonlinear-v0"
FEATURES_ID = "yawrate/PITuningFeatures-v0"
PLANT_ID = "yawrate/Plant-v0"
PLANT_FEATURES_ID = "yawrate/PlantFeatures-v0"

if ENV_ID not in registry:
    register(
        id=ENV_ID,
        entry_point="yawrate_env.env.yaw_rate_env:PITuningEnv",
        vector_entry_point="yawrate_env.env.vector_env:PITuningVectorEnv",
    )

if NONLINEAR_ID not in registry:
    register(
        id=NONLINEAR_ID,
        entry_point="yawrate_env.env.nonlinear_env:PITuningNonlinearEnv",
        vector_entry_point="yawrate_env.env.nonlinear_env:PITuningNonlinearVectorEnv",
    )

if FEATURES_ID not in registry:
    register(
        id=FEATURES_ID,
        entry_point="tuners.agents.wrappers:features_env",
        vector_entry_point="tuners.agents.wrappers:features_vector_env",
    )

if PLANT_ID not in registry:
    register(
        id=PLANT_ID,
        entry_point="yawrate_env.env.plant_env:PlantEnv",
        vector_entry_point="yawrate_env.env.plant_env:PlantVectorEnv",
    )

if PLANT_FEATURES_ID not in registry:
    register(
        id=PLANT_FEATURES_ID,
        entry_point="tuners.agents.wrappers:plant_features_env",
        vector_entry_point="tuners.agents.wrappers:plant_features_vector_env",
    )
