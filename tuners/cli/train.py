"""``yawrate train``."""

from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from tuners import model_file, vehicle_file
from tuners.cli import plant
from tuners.cli.example import example
from tuners.cli.files import READABLE, Output, keep
from tuners.cli.numbers import COUNT
from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.trend import TrendSettings
from yawrate_env.task import Task

if TYPE_CHECKING:
    from tuners import Tuner

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
    help="Of the random vehicles.",
)
def command(vehicle: Path | None, out: Path, episodes: int | None, seed: int) -> None:
    """Train a tuner for a vehicle, and say how accurate it is.

    Its margins' errors on simulated vehicles that no training saw are printed beside the
    Cramér-Rao bound, the least that any unbiased tuner can reach.

    A plant of your own is one line of TOML, entry = "module:attribute" in [plant]; the
    module is found beside the file.
    """
    keep(out, vehicle)
    _check_learner()
    import tuners
    from tuners.calibration import calibrate
    from tuners.plants.entry import from_toml
    from tuners.progress import Bars

    own = None if vehicle is None else from_toml(vehicle)
    if own is not None:
        click.echo(f"{out}: {plant.train(own, out, episodes, seed)}")
        return
    task = Task() if vehicle is None else vehicle_file.read(vehicle)
    recipe = replace(tuners.RECIPES[RECIPE], learner=LEARNER, noise_draws=NOISE_DRAWS)
    with Bars() as bars:
        tuner = tuners.train(recipe, task, episodes=episodes or VEHICLES, seed=seed, progress=bars)
        calibrate(tuner, episodes=CALIBRATION, seed=seed, progress=partial(bars, "calibrating"))
    tuner.save(out)
    click.echo(f"{out}: {accuracy(tuner, task, seed)}")


def _check_learner() -> None:
    """Refuse before the simulations, not after them."""
    if find_spec("torch") is None:
        raise click.ClickException('Training needs PyTorch: pip install "yawrate[tuners]".')


def accuracy(tuner: "Tuner", task: Task, seed: int) -> str:
    """Root mean square errors on fresh vehicles, beside the bound."""
    from tuners.bound import cramer_rao
    from tuners.evaluation import evaluate
    from yawrate_env.contexts import CONTEXT_SETS

    contexts = CONTEXT_SETS["test"]
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
