"""Ready plants: common ones, described by the ranges of their parameters.

Each function gives a `yawrate_env.plant.Plant` and is an entry point, so that a TOML file
suffices (`yawrate init --plant fopdt`).  The vehicle is in `yawrate_env.vehicle`.
"""

from yawrate_env.plants.process import Experiment, fopdt, integrator, sopdt

__all__ = ["Experiment", "fopdt", "integrator", "sopdt"]
