"""``yawrate train``."""

from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from tuners.cli import plant
from tuners.cli.example import example
from tuners.cli.files import READABLE, Output, keep
from tuners.cli.numbers import COUNT
from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.trend import TrendSettings
from tuners.tuner import tuner_file as model_file
from yawrate_env.vehicle import vehicle_file
from yawrate_env.vehicle.task import Task

if TYPE_CHECKING:
    from tuners import Tuner
    from tuners.cli.progress import Bars
    from tuners.plants import Plant, PlantTuner
    from tuners.tuner.two_stage import TwoStage

VALIDATION = 300
RECIPE, VEHICLES, NOISE_DRAWS = "ts-ff-lag-vx", 2000, 3
LEARNER = TrendSettings(FeedForwardSettings(neurons=16, max_fail=10, epochs=120))
CALIBRATION = 3000
"""For any speed and signal; less of everything than the shipped tuner had, to take a minute."""


@click.command(epilog=example("yawrate train --vehicle car.toml -o car.tuner"))
@click.option(
    "--vehicle", type=READABLE, help="A vehicle's TOML file, or a plant's. [default: the paper's]"
)
@click.option(
    "--data",
    "folder",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Learn from a folder of `yawrate dataset`, which says what it is of, instead of "
    "simulating.",
)
@click.option(
    "-o", "--out", type=Output(model_file.SUFFIX), required=True, help="Tuner to write, *.tuner."
)
@click.option(
    "--episodes",
    type=COUNT,
    help=f"Simulated vehicles or plants. [default: {VEHICLES}; 1000 plants]",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Of the random vehicles, the split and the learner.",
)
def command(
    vehicle: Path | None, folder: Path | None, out: Path, episodes: int | None, seed: int
) -> None:
    """Train a tuner for a vehicle, and say how accurate it is.

    Its margins' errors on simulated vehicles that no training saw are printed beside the
    Cramér-Rao bound, the least that any unbiased tuner can reach.

    A plant of your own is one line of TOML, entry = "module:attribute" in [plant]; the
    module is found beside the file.

    With --data everything is learned from that folder's episodes, a part of them in
    memory at a time.  A --vehicle must then be what the folder is of, or is left out; a
    plant's module is found beside the folder too.
    """
    keep(out, vehicle)
    if folder is not None and episodes is not None:
        raise click.UsageError("--data takes the episodes of its folder: leave out --episodes.")
    _check_learner()
    from tuners import plants
    from tuners.cli.progress import Bars
    from yawrate_env.plant.entry import from_toml

    own = None if vehicle is None else from_toml(vehicle)
    task = None if vehicle is None or own is not None else vehicle_file.read(vehicle)
    tuner: Tuner | plants.PlantTuner
    with Bars() as bars:
        if folder is not None:
            tuner = from_folder(folder, own or task, seed, bars)
        elif own is not None:
            tuner = plants.train(own, count=episodes, seed=seed, progress=bars)
        else:
            tuner = simulated(task or Task(), episodes or VEHICLES, seed, bars)
    tuner.save(out)
    if isinstance(tuner, plants.PlantTuner):
        click.echo(f"{out}: {plant.accuracy(tuner, seed)}")
    else:
        click.echo(f"{out}: {accuracy(tuner, seed)}")


def simulated(task: Task, episodes: int, seed: int, bars: "Bars") -> "TwoStage":
    """A vehicle's tuner from simulations, calibrated."""
    import tuners

    recipe = replace(tuners.RECIPES[RECIPE], learner=LEARNER, noise_draws=NOISE_DRAWS)
    tuner = tuners.train(recipe, task, episodes=episodes, seed=seed, name=RECIPE, progress=bars)
    return calibrated(tuner, seed, bars)


def from_folder(
    path: Path, wanted: "Task | Plant | None", seed: int, bars: "Bars"
) -> "TwoStage | PlantTuner":
    """A tuner from a data set, of what is wanted if anything is, calibrated."""
    import tuners
    from tuners import data
    from tuners.plants import Plant

    own = wanted if isinstance(wanted, Plant) else None
    found = data.Folder(path, own).recipe
    of_plants = isinstance(found.what, Plant)
    if wanted is not None and of_plants != (own is not None):
        words = ("plants", "a vehicle's") if of_plants else ("vehicles", "a plant's")
        raise click.UsageError(
            f"{path} holds {words[0]}, and the --vehicle is {words[1]} file. Leave it out: the "
            "folder says what it is of."
        )
    if of_plants:
        return data.train_plant(path, plant=own, seed=seed, progress=bars)
    known = tuners.RECIPES[RECIPE]
    recipe = replace(known, compressor=found.compressor, learner=LEARNER)
    name = RECIPE if recipe.compressor == known.compressor else None
    task = wanted if isinstance(wanted, Task) else None
    tuner = data.train(recipe, path, task=task, seed=seed, name=name, progress=bars)
    return calibrated(tuner, seed, bars)


def calibrated(tuner: "TwoStage", seed: int, bars: "Bars") -> "TwoStage":
    """The tuner, with intervals that hold."""
    from tuners.trust.vehicle_calibration import calibrate

    calibrate(tuner, episodes=CALIBRATION, seed=seed, progress=partial(bars, "calibrating"))
    return tuner


def _check_learner() -> None:
    """Refuse before the simulations, not after them."""
    if find_spec("torch") is None:
        raise click.ClickException('Training needs PyTorch: pip install "yawrate[tuners]".')


def accuracy(tuner: "Tuner", seed: int) -> str:
    """Root mean square errors on fresh vehicles, beside the bound."""
    from tuners.trust.vehicle_bound import cramer_rao
    from tuners.tuner.evaluation import evaluate
    from yawrate_env.vehicle.contexts import CONTEXT_SETS

    contexts, task = CONTEXT_SETS["test"], tuner.task
    (found,) = evaluate({"": tuner}, task, contexts, episodes=VALIDATION, seed=seed, batch=64)
    bound = cramer_rao(task, contexts.draw(task.prior, seed, 0, VALIDATION))
    words = []
    margins = ("phase_margin", "deg"), ("crossover", "Hz")
    for (name, unit), least in zip(margins, bound.T, strict=True):
        error = getattr(found, name) - getattr(task.target, name)
        both = np.isfinite(error + least)  # where a PI reaches the target at all
        rms, limit = (np.sqrt(np.mean(x[both] ** 2)) for x in (error, least))
        words.append(f"{name.replace('_', ' ')} {rms:.2g} {unit} rms (bound {limit:.2g})")
    unstable = np.count_nonzero(~found.stable)
    return f"{', '.join(words)}; {unstable} of {VALIDATION} loops unstable"
