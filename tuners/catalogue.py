"""The tuners by name: how each is trained, and where a trained one is found."""

import os
import warnings
from collections.abc import Callable
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.features.armax import Armax
from tuners.features.laguerre import Laguerre
from tuners.features.response import FrequencyResponse
from tuners.learners import check_arrays
from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.gbm import GBMSettings
from tuners.learners.polynomial import PolynomialSettings
from tuners.learners.trend import TrendSettings
from tuners.trust.emulator import PREFIX, OutputEmulator, with_emulator
from tuners.tuner import tuner_file
from tuners.tuner.against_bound import tell
from tuners.tuner.direct import FictitiousReference, VirtualReference
from tuners.tuner.examples import Examples
from tuners.tuner.method import Method
from tuners.tuner.notes import hidden
from tuners.tuner.recipe_search import Search
from tuners.tuner.recipes import USUAL, Make, Sizes, plants_for, recipe_for
from tuners.tuner.recording import Recording
from tuners.tuner.rivals import BlackBoxRule, GrayBox, Nominal, Oracle
from tuners.tuner.simulations import of_others, shown, simulating, slowness
from tuners.tuner.stages import Recipe, Stages
from tuners.tuner.training import (
    CALIBRATION,
    LEAST_PLANTS,
    begin,
    check_calibration,
    expected,
    finished,
    fit,
)
from tuners.tuner.tuner import Tuner
from yawrate_env import validation
from yawrate_env.plant import entry
from yawrate_env.plant.entry import find
from yawrate_env.plant.episodes import prior_gains
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.task import Experiment, Prior, Task
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
        episodes=7000,
    ),
    "ts-poly-any": Recipe(
        FrequencyResponse(order=32, pole=14.0, low=0.3, high=6.0, points=6),
        PolynomialSettings(degree=3),
        episodes=40_000,
        components=12,
    ),
}
"""The tuners that are trained: the paper's two, the same predicting the gains themselves, the
same learners on Laguerre features with fresh noise on every simulated vehicle, and one for
every speed; and one for every speed and any excitation."""

SPEEDS = {"ts-ff-lag-vx": (10.0, 33.0), "ts-poly-any": (10.0, 33.0)}
"""Speeds that a recipe is for, if not the paper's vehicle at one speed [m/s]."""

REGISTERS = {"ts-poly-any": "random"}
"""Excitations that a recipe is for, if not the same in every episode."""

UNTRAINED: dict[str, type[Method]] = {
    "gb": GrayBox,
    "bb": BlackBoxRule,
    "vrft": VirtualReference,
    "frit": FictitiousReference,
    "oracle": Oracle,
    "nominal": Nominal,
}
"""The tuners that need no training."""

AGENTS = {"rl": "naf", "rl-sac": "sac"}
"""The tuners that learned from rewards, and by which algorithm (`tuners.agents`)."""

NAMES = (*RECIPES, *UNTRAINED, *AGENTS)

Progress = Callable[[str, int, int], None]


def train(
    what: str | Recipe | Plant,
    plant: Plant | str | None = None,
    *,
    episodes: int | None = None,
    seed: int = 0,
    calibration: int | None = None,
    name: str | None = None,
    progress: Progress | None = None,
    data: Examples | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    sizes: Sizes = USUAL,
    make: Make = recipe_for,
    alone: bool = False,
) -> Tuner:
    """Train a two-stage tuner on simulated episodes of the ``train`` set.

    Parameters
    ----------
    what : str, Recipe or Plant
        One of `RECIPES`, a recipe of your own, or a plant, which gets its default recipe.
    plant : Plant or str, optional
        What it is made for, or the plant's entry ``"module:attribute"``; the paper's vehicles if
        omitted.
    episodes : int, optional
        Simulated plants, the recipe's if omitted; 80 % train, the rest validate.
    seed : int
        Of the data and of the learner.
    calibration : int, optional
        Episodes that calibrate the intervals; 0 leaves those of a normal error.  By default
        `CALIBRATION` for a plant's default recipe, else 0.
    name : str, optional
        What the record calls it; its name in `RECIPES`, or else ``"custom"``.
    progress : callable, optional
        Called with the stage's name, how far it is, and how far it goes.  Of a slow plant bars
        with the time that remains are shown if omitted.
    data : Examples, optional
        Data already simulated with these features, instead of new ones.
    workers, scheduler, checkpoint
        Of a slow plant: how many processes simulate, or the address of a Dask scheduler, and a file
        that keeps the simulations, to go on after an interruption (`tuners.tuner.simulations`).
    sizes : Sizes, optional
        Of a plant's default recipe, those that are not to be searched, ``Sizes(order=12)``; plants
        are also given by `episodes`.
    make : callable, optional
        Of default recipes: `recipe_for`, or `recipe_for_logs`.
    alone : bool
        Whether a default recipe's learner must be near the bound even where the fitted plant is,
        as in exported programs, which have no fitted plant.
    """
    if calibration is not None:
        check_calibration(calibration)
    validation.instance("sizes", sizes, Sizes, remedy="Give tuners.tuner.recipes.Sizes(...).")
    recipe: Recipe | None = None
    if isinstance(what, Plant) or (isinstance(what, str) and ":" in what):
        if plant is not None:
            raise ValueError("plant is given twice. Leave one out, or give a recipe first.")
        plant, known = find(what), "two-stage"
        calibration = CALIBRATION if calibration is None else calibration
        if episodes is not None:
            validation.count("episodes", episodes, at_least=LEAST_PLANTS, remedy="Simulate more.")
            sizes = replace(sizes, plants=episodes)
    else:
        if sizes.given or alone:
            what_of = "sizes" if sizes.given else "alone"
            raise ValueError(f"{what_of} is for a plant's default recipe. Leave it out.")
        known, recipe = recipe_named(what)
        plant = yaw_rate(_task(known)) if plant is None else find(plant)
    prior_gains(plant)  # refuses a plant of which nothing can be learned
    if said := slowness(plant):
        warnings.warn(said, stacklevel=2)
    count = episodes or sizes.plants or (plants_for(plant) if recipe is None else recipe.episodes)
    total = expected(plant, count, calibration or 0)
    with (
        shown(plant, progress) as bars,
        simulating(plant, workers, scheduler, checkpoint, bars, total) as ready,
    ):
        report = of_others(plant, bars)
        if plant.slow:
            begin(ready, count, calibration or 0, seed)
        usual = recipe or make(ready, sizes)
        stages, training = fit(
            ready, usual, count=episodes, seed=seed, name=name or known, data=data, progress=report,
        )  # fmt: skip
        search = Search(make, sizes, usual, seed, calibration or 0, alone, report)
        improve = search if recipe is None else None
        tuner = finished(ready, stages, training, calibration or 0, report, improve)
    tuner.plant = with_emulator(plant, tuner.plant.emulator)
    tell(tuner)
    return tuner


def recipe_named(recipe: str | Recipe) -> tuple[str, Recipe]:
    """A recipe and what to call it."""
    if isinstance(recipe, str):
        return recipe, RECIPES[validation.one_of("tuner", recipe, tuple(RECIPES))]
    remedy = "Give a name, a tuners.Recipe or a tuners.Plant."
    validation.instance("recipe", recipe, Recipe, remedy=remedy)
    return next((name for name, known in RECIPES.items() if known == recipe), "custom"), recipe


def _task(name: str) -> Task:
    """The paper's vehicles at a recipe's speeds, with its excitation."""
    prior = Prior(v_x=SPEEDS[name]) if name in SPEEDS else Prior()
    return Task(prior=prior, experiment=Experiment(register=REGISTERS.get(name, "same")))


def load(name: str | os.PathLike[str], plant: Plant | None = None) -> Tuner:
    """A tuner ready to use: by name, or from a ``.tuner`` file.  Nothing is trained.

    Parameters
    ----------
    name : str or path
        One of `NAMES`, or a file that `Tuner.save` wrote.
    plant : Plant, optional
        What the tuners that need no training are made for, the paper's vehicles if omitted; for
        a file its plant, if it should not be imported from the entry that the file names.  The
        trained ones of the package keep the vehicles that they were trained for.
        Importing a plant runs its code: look at it first where it comes from somebody else.

    Raises
    ------
    ValueError
        No such name; a file that is damaged, foreign or missing; or a plant that is missing or
        has changed since the tuner was trained.
    """
    if plant is not None:
        validation.instance("plant", plant, Plant, remedy="Describe a tuners.Plant.")
    if str(name).endswith(tuner_file.SUFFIX):
        return from_file(name, plant)
    validation.one_of("tuner", name, NAMES)
    if str(name) in UNTRAINED:
        method = UNTRAINED[str(name)].from_file({}, {})
        return Tuner(plant or yaw_rate(Task(), check=False), method, {"name": str(name)})
    path = shipped(str(name))
    settings, arrays = tuner_file.read(path)
    with tuner_file.rebuilding(path):
        # Tests compare the package's vehicles with its files.  To do so at every start would
        # compile kernels that a first answer does not need.
        return _rebuilt(path, settings, arrays, yaw_rate(_task(str(name)), check=False))


def shipped(name: str) -> Path:
    """Where the package keeps the trained tuner `name`."""
    return Path(str(files("tuners") / "models" / f"{name}{tuner_file.SUFFIX}"))


def from_file(path: str | os.PathLike[str], plant: Plant | None = None) -> Tuner:
    """Read a tuner that `Tuner.save` wrote, and try it once."""
    settings, arrays = tuner_file.read(path)
    with tuner_file.rebuilding(path):
        found = tuner_file.plant_of(path, settings, plant)
        return _rebuilt(path, settings, arrays, found)


def _rebuilt(
    path: str | os.PathLike[str],
    settings: dict[str, Any],
    arrays: dict[str, NDArray[Any]],
    plant: Plant,
) -> Tuner:
    """The tuner of a file's content for its plant, tried once."""
    kinds: dict[str, type[Method]] = {kind.kind: kind for kind in UNTRAINED.values()}
    kinds[Stages.kind] = Stages
    check_arrays(arrays)
    for name in _entries(settings):
        entry.attribute(name, Path(path).parent)
    arrays, emulated = _parted(arrays)
    if emulated:
        emulator = OutputEmulator.from_arrays(plant, emulated)
        plant = plant.with_simulator(plant.simulate, emulator)
    method = kinds[settings["method"]].from_file(settings, arrays)
    factors = [_factors(settings, n, plant) for n in ("calibration", "exact_calibration")]
    training = validation.instance("training", settings["training"], dict, remedy="")
    hidden(training.get("hides", ()))
    tuner = Tuner(plant, method, training, *factors)
    _try(tuner)
    return tuner


def _entries(settings: dict[str, Any]) -> list[str]:
    """Where stages that are not the package's are found; each imports its module."""
    stage = settings.get("features")
    named = stage["name"] if isinstance(stage, dict) else "", settings.get("learner", "")
    return [name for name in named if ":" in name]


def _parted(
    arrays: dict[str, NDArray[Any]],
) -> tuple[dict[str, NDArray[Any]], dict[str, NDArray[Any]]]:
    """Arrays of a file: the method's, and those of the plant's emulator."""
    own = {name: a for name, a in arrays.items() if not name.startswith(PREFIX)}
    named = {name: a for name, a in arrays.items() if name.startswith(PREFIX)}
    return own, {name.removeprefix(PREFIX): a for name, a in named.items()}


def _factors(settings: dict[str, Any], name: str, plant: Plant) -> tuple[float, ...]:
    """Half widths of the intervals that a file holds, checked."""
    factors = validation.finite_array(name, settings[name], shape=(len(plant.counted),))
    if (factors < 0).any():
        raise ValueError(f"{name} has {factors.min():g}, which is no width.")
    return tuple(factors.tolist())


def _try(tuner: Tuner) -> None:
    """Find gains for the mid-prior plant once; ``ValueError`` for none, or a wrong number."""
    plant = tuner.plant
    recording = Recording(plant.u[None], plant.respond(plant.middle), plant.Ts, plant.middle)
    with np.errstate(all="ignore"):
        answered = tuner.method.gains(plant, recording).values
    if answered.shape != (1, len(plant.gains)):
        raise ValueError(f"it answers {answered.shape[1]} gains, not {len(plant.gains)}.")
    if tuner.method.kind == Stages.kind and not np.isfinite(answered).all():
        raise ValueError("it finds no gains for a plant in the middle of its prior.")
