"""``yawrate train``."""

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np
from numpy.typing import NDArray

from tuners.cli.arguments import COUNT, SEED, Output, example, refuse_overwriting, vehicle_option
from tuners.cli.sources import plant_from
from tuners.cli.text import metric_name, quantity, unit_of
from tuners.tuner.tuner_file import SUFFIX
from yawrate_env.plant.plant import Plant

if TYPE_CHECKING:
    from tuners import Tuner
    from tuners.tuner.comparison import Comparison

VALIDATION = 300

CALIBRATION = 2000
"""Episodes that calibrate the intervals."""

ENOUGH, LEAKS = 100, 0.7
"""Test episodes, and the share of the least error, below which an error is too good to be true."""

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

    First come parameters of the prior that the experiment cannot tell apart or does not show.

    The errors of its metrics on simulated plants of the test set are printed beside the
    Cramér-Rao bound, the least that an unbiased tuner can reach, with the share of these
    recordings that it will find usable, or usable with care. An error far below what the noise
    and the prior allow is warned of.  Faults of recordings that the prior hides, so that no check
    can see them, are listed with what they cost.

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
    from tuners.trust.distinction import distinction
    from tuners.tuner.against_bound import remarks
    from tuners.tuner.hidden_faults import as_record, hidden_faults, sentences

    given = None if folder is not None and vehicle is None else plant_from(vehicle)
    if folder is None:
        assert given is not None
        plant = given
    else:
        from tuners import data

        plant = data.Folder(folder, given).recipe.plant
    for sentence in distinction(plant).sentences():
        click.echo(sentence)
    with Bars() as bars:
        if folder is not None:
            tuner = data.train(folder, plant=plant, seed=seed, progress=bars)
        else:
            from tuners.tuner.training import recipe_for_logs

            recipe = recipe_for_logs(plant)
            tuner = tuners.train(
                recipe, plant, episodes=episodes, seed=seed, calibration=CALIBRATION, progress=bars
            )
    hidden = hidden_faults(tuner, seed)
    tuner.training["hides"] = as_record(hidden)
    tuner.save(out)
    said = [f"{out}: {accuracy(tuner, seed)}", *remarks(tuner), *sentences(hidden)]
    click.echo("\n".join(said))


def accuracy(tuner: "Tuner", seed: int) -> str:
    """Root mean square errors on test plants, beside the bound, and how many are usable."""
    from tuners.tuner.comparison import TUNER, compare

    found = compare(tuner, VALIDATION, seed)
    bounds = (_rms(each) for each in (found.bound, found.informed))
    errors = [
        f"{metric_name(name)} {quantity(rms, unit_of(name), 2)} rms ("
        + (f"bound {least:.2g})" if np.isfinite(least) else f"bound {informed:.2g} with the prior)")
        for name, rms, least, informed in zip(
            tuner.plant.counted, found.rms(TUNER), *bounds, strict=True
        )
    ]
    unstable = found.unstable(TUNER)
    usable, careful = ((found.verdicts == verdict).mean() for verdict in (0, 1))
    said = (
        f"{', '.join(errors)}; {unstable} of {VALIDATION} loops unstable; of these recordings "
        f"{usable:.0%} will be usable, {careful:.0%} usable with care"
    )
    if found.trusted.mean() <= USUAL:
        said += ", more would be with larger scales of the metrics"
    return "\n".join([said, *leaks(tuner.plant, found)])


def _rms(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Root mean squares (f,) of the rows (B, f) that are numbers; ``inf`` where none is."""
    known = values[~np.isnan(values).any(axis=1)]
    means = (known**2).mean(axis=0) if len(known) else np.full(values.shape[1], np.inf)
    return np.asarray(np.sqrt(means))


def leaks(plant: Plant, found: "Comparison") -> list[str]:
    """Warnings for metrics that the tuner finds better than its data and the prior allow."""
    from tuners.tuner.comparison import TUNER

    errors, said = found.errors[TUNER], []
    for i, name in enumerate(plant.counted):
        both = np.isfinite(errors[:, i]) & np.isfinite(found.informed[:, i])
        if both.sum() < ENOUGH:
            continue
        rms, least = (np.sqrt((x[both, i] ** 2).mean()) for x in (errors, found.informed))
        if rms < LEAKS * least:
            unit = unit_of(name)
            said.append(
                f"Warning: {metric_name(name)} {quantity(rms, unit, 2)} rms is far below the "
                f"{quantity(least, unit, 2)} that the noise allows: the simulator leaks the "
                "answer, or the noise is not applied."
            )
    return said
