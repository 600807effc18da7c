"""The tuners by name: how each is trained, and where a trained one is found."""

import os
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

from tuners.agents.rl_tuner import RLTuner
from tuners.features.armax import Armax
from tuners.features.laguerre import Laguerre
from tuners.features.response import FrequencyResponse
from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.gbm import GBMSettings
from tuners.learners.trend import TrendSettings
from tuners.trust.vehicle_trust import Calibration
from tuners.tuner import tuner_file as model_file
from tuners.tuner.baselines import Nominal, Oracle
from tuners.tuner.gray_box import GrayBox
from tuners.tuner.stages import Recipe
from tuners.tuner.training import fit
from tuners.tuner.tuner import Tuner
from tuners.tuner.two_stage import TwoStage
from yawrate_env import validation
from yawrate_env.plant.episodes import Examples
from yawrate_env.vehicle.task import Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

RECIPES = {
    "ts-gbm": Recipe(Armax(), GBMSettings()),
    "ts-ff": Recipe(Armax(), FeedForwardSettings()),
    "ts-gbm-gains": Recipe(Armax(), GBMSettings(), "gains"),
    "ts-ff-gains": Recipe(Armax(), FeedForwardSettings(), "gains"),
    "ts-ff-lag": Recipe(
        Laguerre(order=8, pole=12.0),
        FeedForwardSettings(neurons=16, max_fail=10),
        noise_draws=12,
    ),
    "ts-gbm-lag": Recipe(
        Laguerre(order=8, pole=12.0),
        TrendSettings(
            GBMSettings(n_estimators=300, max_depth=4, max_leaves=0, learning_rate=0.1), degree=2
        ),
        noise_draws=12,
    ),
    "ts-ff-lag-vx": Recipe(
        FrequencyResponse(order=12, pole=12.0, low=0.3, high=6.0, points=6),
        TrendSettings(FeedForwardSettings(neurons=28, max_fail=10, epochs=400)),
        noise_draws=4,
        vehicles=7000,
        v_x=(10.0, 33.0),
    ),
}
"""The tuners that are trained: the paper's two, the same with its literal targets, the
same learners on Laguerre features with fresh noise on every simulated vehicle, and one
for every speed."""

UNTRAINED: dict[str, type[Tuner]] = {"gb": GrayBox, "oracle": Oracle, "nominal": Nominal}
"""The tuners that need no training."""

NAMES = (*RECIPES, *UNTRAINED, "rl")

TRAINING_SEED = 0

Progress = Callable[[str, int, int], None]


def train(
    tuner: str | Recipe,
    task: Task | None = None,
    *,
    episodes: int | None = None,
    seed: int = TRAINING_SEED,
    name: str | None = None,
    progress: Progress | None = None,
    dataset: Examples | None = None,
) -> TwoStage:
    """Train a two-stage tuner on simulated episodes of the ``train`` set.

    Parameters
    ----------
    tuner : str or Recipe
        One of `RECIPES`, or any other combination of the three parts.
    task : Task, optional
        What it shall work for; the default vehicles at the recipe's speeds if not given.
    episodes : int, optional
        Simulated vehicles, the recipe's if not given; 80 % train, the rest validate.
    seed : int
        Of the data and of the learner.
    name : str, optional
        What the record calls it; its name in `RECIPES`, or else ``"custom"``.
    progress : callable, optional
        Called with what is being done, how far it is, and how far it goes.
    dataset : Examples, optional
        Data already simulated with this compressor, instead of new.
    """
    known, recipe = named(tuner)
    task = Task(prior=Prior(v_x=recipe.v_x)) if task is None else _checked(task)
    stages, training = fit(
        yaw_rate(task, recipe.coordinates),
        recipe,
        count=episodes,
        seed=seed,
        name=name or known,
        data=dataset,
        progress=progress,
    )
    return TwoStage(task, stages, recipe.coordinates, training)


def named(tuner: str | Recipe) -> tuple[str, Recipe]:
    """A recipe and what to call it."""
    if isinstance(tuner, Recipe):
        return next((name for name, of in RECIPES.items() if of == tuner), "custom"), tuner
    return tuner, RECIPES[validation.one_of("tuner", tuner, tuple(RECIPES))]


def load(name: str | os.PathLike[str], task: Task | None = None) -> Tuner:
    """A tuner ready to use: by name, or from a ``.tuner`` file.  Nothing is trained.

    Parameters
    ----------
    name : str or path
        One of `NAMES`, or a file that `Tuner.save` wrote.
    task : Task, optional
        What the tuners that need no training shall work for; the trained ones keep
        the task that they were trained for.

    Raises
    ------
    ValueError
        No such name, or a file that is damaged, foreign or missing.
    """
    task = Task() if task is None else _checked(task)
    if str(name).endswith(model_file.SUFFIX):
        return from_file(name)
    validation.one_of("tuner", name, NAMES)
    if str(name) in UNTRAINED:
        return UNTRAINED[str(name)](task)
    return from_file(shipped(str(name)))


def _checked(task: Task) -> Task:
    if not isinstance(task, Task):
        raise ValueError(
            f"task = {task!r} is not a Task. Make one with yawrate_env.vehicle.task.Task."
        )
    return task


def shipped(name: str) -> Path:
    """Where the package keeps the trained tuner `name`."""
    return Path(str(files("tuners") / "models" / f"{name}{model_file.SUFFIX}"))


def from_file(path: str | os.PathLike[str]) -> Tuner:
    """Read a tuner that `Tuner.save` wrote."""
    settings, arrays = model_file.read(path)
    if settings.get("kind") == "plant":
        raise model_file.ModelFileError(
            f"{path} is for a plant. Use tuners.plants.load, or the command tune."
        )
    known: tuple[type[Tuner], ...] = (*UNTRAINED.values(), TwoStage, RLTuner)
    kinds = {cls.kind: cls for cls in known}
    with model_file.rebuilding(path):
        tuner = kinds[settings["kind"]].from_file(settings, arrays)
        tuner.calibration = Calibration(**settings.get("calibration", {}))
    return tuner
