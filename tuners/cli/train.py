"""``yawrate train``."""

from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from tuners import model_file, vehicle_file
from tuners.cli.example import example
from tuners.cli.files import READABLE, Output
from tuners.cli.numbers import COUNT
from yawrate_env.task import Task

if TYPE_CHECKING:
    from tuners import Tuner

VALIDATION = 300
ONE_SPEED, ANY_SPEED = "ts-ff-lag", "ts-ff-lag-vx"


@click.command(epilog=example("yawrate train --vehicle car.toml -o car.tuner"))
@click.option("--vehicle", type=READABLE, help="A vehicle's TOML file. [default: the paper's]")
@click.option(
    "-o", "--out", type=Output(model_file.SUFFIX), required=True, help="Tuner to write, *.tuner."
)
@click.option(
    "--episodes",
    type=COUNT,
    default=1500,
    show_default=True,
    help="Simulated vehicles.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Of the random vehicles.",
)
def command(vehicle: Path | None, out: Path, episodes: int, seed: int) -> None:
    """Train a tuner for a vehicle, and say how accurate it is.

    Its margins' errors on simulated vehicles that no training saw are printed beside the
    Cramér-Rao bound, the least that any unbiased tuner can reach.
    """
    import tuners
    from tuners.progress import Bars

    task = Task() if vehicle is None else vehicle_file.read(vehicle)
    low, high = task.prior.v_x
    name = ONE_SPEED if low == high else ANY_SPEED
    with Bars() as bars:
        tuner = tuners.train(name, task, episodes=episodes, seed=seed, progress=bars)
    tuner.save(out)
    click.echo(f"{out}: {name}, {accuracy(tuner, task, seed)}")


def accuracy(tuner: "Tuner", task: Task, seed: int) -> str:
    """Root mean square errors on fresh vehicles, beside the bound."""
    from tuners.bound import cramer_rao
    from tuners.evaluation import evaluate
    from yawrate_env.contexts import CONTEXT_SETS

    contexts = CONTEXT_SETS["test"]
    (found,) = evaluate({"": tuner}, task, contexts, episodes=VALIDATION, seed=seed, batch=64)
    bound = cramer_rao(task, contexts.draw(task.prior, seed, 0, VALIDATION))
    least = np.sqrt(np.mean(bound**2, axis=0))
    words = []
    for name, unit, limit in (("phase_margin", "deg", least[0]), ("crossover", "Hz", least[1])):
        error = getattr(found, name) - getattr(task.target, name)
        rms = np.sqrt(np.mean(error**2))
        words.append(f"{name.replace('_', ' ')} {rms:.2g} {unit} rms (bound {limit:.2g})")
    return f"{', '.join(words)}; {np.count_nonzero(~found.stable)} of {VALIDATION} unstable"
