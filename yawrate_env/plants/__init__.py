"""Ready plants: common ones, described by the ranges of their parameters.

Each function gives a `yawrate_env.plant.Plant` and is an entry point, so that a TOML file
suffices (`yawrate init --plant fopdt`).  The vehicle is in `yawrate_env.vehicle`.
"""

from importlib.resources import files

from yawrate_env.plants.experiment import Experiment
from yawrate_env.plants.process import dc_motor, fopdt, integrator, sopdt, thermal

__all__ = ["Experiment", "dc_motor", "fopdt", "integrator", "sopdt", "template", "thermal"]

NAMES = "fopdt", "sopdt", "integrator", "dc_motor", "thermal"


def template(name: str) -> str:
    """A TOML file of the ready plant called `name`, with a comment on every value."""
    return (files("yawrate_env.plants") / f"{name}.toml").read_text(encoding="utf-8")
