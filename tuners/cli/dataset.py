"""``yawrate dataset``."""

from pathlib import Path

import click

from tuners import features
from tuners.cli.arguments import COUNT, SEED, example, vehicle_option
from tuners.cli.sources import plant_from
from yawrate_env.plant.episodes import SETS

SAMPLE = 100


@click.command(epilog=example("yawrate dataset --episodes 1e6 --out big --workers 2"))
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    required=True,
    help="Folder to write or to continue.",
)
@click.option("--episodes", type=COUNT, help="Number of episodes; 1e6 is a million.")
@click.option(
    "--set",
    "--context",
    "name",
    type=click.Choice(list(SETS)),
    default="train",
    show_default=True,
    help="Set of episodes.",
)
@click.option(
    "--features",
    "--compressor",
    "stage",
    type=click.Choice(features.BY_NAME),
    default="laguerre",
    show_default=True,
    help="First stage that makes the features.",
)
@vehicle_option
@click.option("--seed", type=SEED, default=0, show_default=True, help="Seed of the episodes.")
@click.option("--shard-size", type=COUNT, help="Episodes in a file. [default: 4096, raw 512]")
@click.option("--raw", is_flag=True, help="Keep the recordings too.")
@click.option("--workers", type=COUNT, help="Processes. [default: one a core]")
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Address of a Dask scheduler, or local for a cluster of --workers.",
)
@click.option(
    "--verify",
    is_flag=True,
    help=f"Read every byte of a finished folder, and simulate {SAMPLE} episodes again.",
)
def command(
    out: Path, episodes: int | None, name: str, stage: str, vehicle: Path | None, seed: int,
    shard_size: int | None, raw: bool, workers: int | None, scheduler: str | None, verify: bool,
) -> None:  # fmt: skip
    """Simulate a data set of episodes, on this machine's cores or on a cluster.

    Call an interrupted run again to continue it.  A folder that holds fewer episodes than
    asked for grows; one that holds more is refused.

    A plant's module is found beside its TOML file, beside the folder, in the working
    folder, and by PYTHONPATH.
    """
    if verify and not out.is_dir():
        raise click.UsageError(f"{out} is not a folder.")
    if not verify and episodes is None:
        raise click.UsageError("--episodes is missing.")
    from tuners import data
    from tuners.cli.progress import Bars
    from tuners.tuner.recipes import features_by_name

    with Bars() as bars:
        if verify:
            plant = None if vehicle is None else plant_from(vehicle)
            found = data.verify(out, sample=SAMPLE, plant=plant, progress=bars)
        else:
            plant = plant_from(vehicle)
            found = data.generate(
                plant, name, features_by_name(plant, stage), episodes or 0, seed, out,
                shard_size=shard_size, workers=workers, scheduler=scheduler, raw=raw,
                progress=bars,
            )  # fmt: skip
    click.echo(f"{out}: {len(found)} episodes{', intact' if verify else ''}")
