"""``yawrate train``."""

from contextlib import AbstractContextManager
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

CALIBRATION, OF_SLOW = 2000, 500
"""Episodes that calibrate the intervals, and those of a slow plant."""

KEPT = ".simulations"
"""Ends the name of the file beside the tuner that keeps a slow plant's simulations meanwhile."""

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
@click.option("--workers", type=COUNT, help="Processes, for a slow plant. [default: one a core]")
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Address of a Dask scheduler, or local for a cluster of --workers, for a slow plant.",
)
def command(
    vehicle: Path | None,
    folder: Path | None,
    out: Path,
    episodes: int | None,
    seed: int,
    workers: int | None,
    scheduler: str | None,
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

    A plant described with slow=True is simulated in processes, and what is simulated is kept
    beside the tuner until that is finished: call an interrupted training again to continue it.

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
    from tuners.trust.emulator import with_emulator
    from tuners.tuner import emulator_check
    from tuners.tuner.against_bound import remarks
    from tuners.tuner.hidden_faults import as_record, hidden_faults, sentences
    from tuners.tuner.simulations import simulating, slowness
    from tuners.tuner.training import recipe_for_logs

    given = None if folder is not None and vehicle is None else plant_from(vehicle)
    if folder is None:
        assert given is not None
        plant = given
    else:
        from tuners import data

        plant = data.Folder(folder, given).recipe.plant
    if slowly := slowness(plant):
        click.echo(f"Note: {slowly}")
    kept = out.with_name(f"{out.name}{KEPT}") if plant.slow else None

    def ready(bars: Bars | None = None) -> AbstractContextManager[Plant]:
        return simulating(plant, workers, scheduler, kept, bars)

    with ready() as quick:
        for sentence in distinction(quick).sentences():
            click.echo(sentence)
        recipe = recipe_for_logs(quick)
    with Bars() as bars:
        if folder is not None:
            tuner = data.train(folder, plant=plant, seed=seed, progress=bars)
        else:
            tuner = tuners.train(
                recipe, plant, episodes=episodes, seed=seed, progress=bars, workers=workers,
                calibration=OF_SLOW if plant.slow else CALIBRATION, scheduler=scheduler,
                checkpoint=kept,
            )  # fmt: skip
    with Bars() as bars, ready(bars) as quick:
        emulator, trained = tuner.plant.emulator, tuner.plant
        tuner.plant = with_emulator(quick, emulator)
        hidden = hidden_faults(tuner, seed)
        tuner.training["hides"] = as_record(hidden)
        measured = accuracy(tuner, seed)
        tuner.plant = trained
    tuner.save(out)
    if kept is not None:
        kept.unlink(missing_ok=True)
    said = [f"{out}: {measured}", *remarks(tuner), *sentences(hidden)]
    click.echo("\n".join([*said, *emulator_check.sentences(tuner.training)]))


def accuracy(tuner: "Tuner", seed: int) -> str:
    """Root mean square errors on test plants, beside the bound, and how many are usable."""
    from tuners.tuner.comparison import TUNER, compare

    found = compare(tuner, VALIDATION, seed, gray_box=False)
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
