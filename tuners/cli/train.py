"""``yawrate train``."""

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from tuners.cli.arguments import COUNT, SEED, Output, example, refuse_overwriting, vehicle_option
from tuners.cli.sources import plant_from
from tuners.cli.text import metric_name, quantity, unit_of
from tuners.tuner.tuner_file import SUFFIX

if TYPE_CHECKING:
    from tuners import Tuner

VALIDATION = 300

CALIBRATION = 2000
"""Episodes that calibrate the intervals."""

USUAL = 0.95
"""Share of the validation recordings that are trusted; below it the output names a remedy."""


@click.command(epilog=example("yawrate train --vehicle car.toml -o car.tuner"))
@vehicle_option
@click.option(
    "--data",
    "folder",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Learn from a folder of `yawrate dataset` instead of simulating.",
)
@click.option("-o", "--out", type=Output(SUFFIX), required=True, help=f"Tuner to write, *{SUFFIX}.")
@click.option("--episodes", type=COUNT, help="Simulated plants. [default: 1000 to 2000]")
@click.option(
    "--seed",
    type=SEED,
    default=0,
    show_default=True,
    help="Seed of the episodes, the split and the learner.",
)
def command(
    vehicle: Path | None, folder: Path | None, out: Path, episodes: int | None, seed: int
) -> None:
    """Train a tuner for a vehicle or another plant, and print its accuracy.

    The errors of its metrics on simulated plants of the test set are printed beside the
    Cramér-Rao bound, the least that an unbiased tuner can reach.

    Another plant than a vehicle is one line of TOML, entry = "module:attribute" in
    [plant]; the module is found beside the file.

    With --data all is learned from that folder's episodes, a part of them in memory at a
    time.  The folder says what it is of: a --vehicle must be the same, or is left out.
    """
    refuse_overwriting(out, vehicle)
    if folder is not None and episodes is not None:
        raise click.UsageError("--data takes the episodes of its folder: leave out --episodes.")
    if find_spec("torch") is None:
        raise click.ClickException('Training needs PyTorch: pip install "yawrate[tuners]".')
    import tuners
    from tuners.cli.progress import Bars

    with Bars() as bars:
        if folder is not None:
            from tuners import data

            plant = None if vehicle is None else plant_from(vehicle)
            tuner = data.train(folder, plant=plant, seed=seed, progress=bars)
        else:
            from tuners.tuner.training import recipe_for_logs

            plant = plant_from(vehicle)
            recipe = recipe_for_logs(plant)
            tuner = tuners.train(
                recipe, plant, episodes=episodes, seed=seed, calibration=CALIBRATION, progress=bars
            )
    tuner.save(out)
    click.echo(f"{out}: {accuracy(tuner, seed)}")


def accuracy(tuner: "Tuner", seed: int) -> str:
    """Root mean square errors on plants of the test set, beside the bound."""
    from tuners.tuner.comparison import TUNER, compare

    found = compare(tuner, VALIDATION, seed)
    bound = np.sqrt(np.nanmean(found.bound**2, axis=0))
    errors = [
        f"{metric_name(name)} {quantity(rms, unit_of(name), 2)} rms (bound {least:.2g})"
        for name, rms, least in zip(tuner.plant.counted, found.rms(TUNER), bound, strict=True)
    ]
    unstable, trusted = found.unstable(TUNER), found.trusted.mean()
    said = f"{', '.join(errors)}; {unstable} of {VALIDATION} loops unstable; {trusted:.0%} trusted"
    if hidden := tuner.training.get("left_open"):
        shares = (f"{name} in {share:.0%}" for name, share in hidden.items())
        said += f"; recordings do not tell {', '.join(shares)} of plants"
    return said if trusted > USUAL else f"{said}, more would be with larger scales of the metrics"
