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
@click.option("--episodes", type=COUNT, help="Simulated plants. [default: 1000 or 2000, searched]")
@click.option("--order", type=COUNT, help="Functions of the first stage. [default: searched]")
@click.option(
    "--pole",
    type=click.FloatRange(min=0.0, min_open=True),
    help="Their pole, in rad/s. [default: searched]",
)
@click.option("--neurons", type=COUNT, help="Of the second stage. [default: searched]")
@click.option(
    "--alone",
    is_flag=True,
    help="Search for a learner that is near the bound without the fitted plant, for export.",
)
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
    order: int | None,
    pole: float | None,
    neurons: int | None,
    alone: bool,
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

    The recipe is the usual one where its learner is within 1.1 times the bound, or the step on the
    plant fitted to a recording gets there, which then answers. Else order and pole of the first
    stage, neurons and plants are searched, but for those that are given. A table lists what was
    tried.

    With --data all is learned from that folder's episodes, a part of them in memory at a
    time.  The folder says what it is of: a --vehicle must be the same, or is left out.
    """
    refuse_overwriting(out, vehicle)
    sizes = {"episodes": episodes, "order": order, "pole": pole, "neurons": neurons}
    given = [name for name, value in sizes.items() if value is not None] + ["alone"] * alone
    if folder is not None and given:
        raise click.UsageError(f"--data takes what its folder holds: leave out --{given[0]}.")
    if find_spec("torch") is None:
        raise click.ClickException('Training needs PyTorch: pip install "yawrate[tuners]".')
    import tuners
    from tuners.cli.progress import Bars
    from tuners.trust.distinction import distinction
    from tuners.trust.emulator import with_emulator
    from tuners.tuner import emulator_check
    from tuners.tuner.against_bound import remarks
    from tuners.tuner.hidden_faults import as_record, hidden_faults, sentences
    from tuners.tuner.recipes import Sizes, recipe_for_logs
    from tuners.tuner.simulations import simulating, slowness

    described = None if folder is not None and vehicle is None else plant_from(vehicle)
    if folder is None:
        assert described is not None
        plant = described
    else:
        from tuners import data

        plant = data.Folder(folder, described).recipe.plant
    if slowly := slowness(plant):
        click.echo(f"Note: {slowly}")
    kept = out.with_name(f"{out.name}{KEPT}") if plant.slow else None

    def ready(bars: Bars | None = None) -> AbstractContextManager[Plant]:
        return simulating(plant, workers, scheduler, kept, bars)

    with ready() as quick:
        for sentence in distinction(quick).sentences():
            click.echo(sentence)
    with Bars() as bars:
        if folder is not None:
            tuner = data.train(folder, plant=plant, seed=seed, progress=bars)
        else:
            tuner = tuners.train(
                plant, make=recipe_for_logs, sizes=Sizes(order, pole, neurons, episodes),
                alone=alone, seed=seed, progress=bars, workers=workers, scheduler=scheduler,
                calibration=OF_SLOW if plant.slow else CALIBRATION, checkpoint=kept,
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
    said = [f"{out}: {measured}", *recipe_table(tuner), *remarks(tuner), *sentences(hidden)]
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


_SIZES = "order", "pole", "neurons", "plants"


def recipe_table(tuner: "Tuner") -> list[str]:
    """The recipes that were tried, their errors over the bound, and who answers; lines."""
    training, names = tuner.training, tuner.plant.counted
    if "search" not in training:
        return []
    beside, rows = training["against_bound"], []

    def cells(ratio: dict[str, float]) -> list[str]:
        return [f"{ratio[name]:.2f}" for name in names]

    def quarter(of: str) -> str:
        return f"{max(beside[of]['quarter'].values()):.2f}"

    for row in training["search"]["tried"]:
        sizes = [f"{row[name]:.3g}" if name == "pole" else str(row[name]) for name in _SIZES]
        ends = [quarter("learner"), "chosen"] if row["chosen"] else ["", row["stage"]]
        rows.append([*sizes, *cells(row["ratio"]), *ends])
    answers = "answers" if training["answers"] == "FITTED_PLANT" else ""
    fitted = cells(beside["fitted_plant"]["ratio"])
    rows.append(["fitted plant", "", "", "", *fitted, quarter("fitted_plant"), answers])
    heads = [*_SIZES, *map(metric_name, names), "worst quarter", ""]
    lines = [heads, *rows]
    widths = [max(len(line[i]) for line in lines) for i in range(len(heads))]
    return ["Recipes, with errors over the bound on plants that none of them learned from:"] + [
        "  " + "  ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)).rstrip()
        for line in lines
    ]


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
