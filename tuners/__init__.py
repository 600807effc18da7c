"""One-shot controller tuners: a recorded episode in, gains out.

``tuners.load(name or file)`` gives a tuner ready to use, ``tuners.train(name, recipe or plant)``
trains one; ``tune(u, y, Ts)`` answers for one recording, ``predict(obs)`` acts as a policy in the
plant's environment.  The plants and environments are in `yawrate_env`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tuners.catalogue import NAMES, RECIPES, load, train
    from tuners.tuner.recording import Recording
    from tuners.tuner.result import Result
    from tuners.tuner.schedule import Schedule, schedule
    from tuners.tuner.stages import Recipe
    from tuners.tuner.tuner import Tuner
    from tuners.tuner.tuner_file import TunerFileError
    from yawrate_env.plant.distributions import LogRange, Normal
    from yawrate_env.plant.metric import Metric
    from yawrate_env.plant.parametrisation import Parametrisation
    from yawrate_env.plant.plant import Plant

_PLACES = {
    "NAMES": "tuners.catalogue",
    "RECIPES": "tuners.catalogue",
    "load": "tuners.catalogue",
    "train": "tuners.catalogue",
    "Recording": "tuners.tuner.recording",
    "Result": "tuners.tuner.result",
    "Recipe": "tuners.tuner.stages",
    "Schedule": "tuners.tuner.schedule",
    "schedule": "tuners.tuner.schedule",
    "Tuner": "tuners.tuner.tuner",
    "TunerFileError": "tuners.tuner.tuner_file",
    "Metric": "yawrate_env.plant.metric",
    "LogRange": "yawrate_env.plant.distributions",
    "Normal": "yawrate_env.plant.distributions",
    "Parametrisation": "yawrate_env.plant.parametrisation",
    "Plant": "yawrate_env.plant.plant",
}
"""Where the names are; imported when asked for, so that `yawrate --help` need not wait."""

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


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_PLACES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
