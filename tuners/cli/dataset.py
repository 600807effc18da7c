"""``yawrate dataset``."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from tuners import features as compressors
from tuners.cli.example import example
from tuners.cli.files import READABLE
from tuners.cli.numbers import COUNT
from yawrate_env.vehicle import vehicle_file
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.task import Task

if TYPE_CHECKING:
    from tuners.features import FirstStage
    from tuners.plants import Plant

SAMPLE = 100


@click.command(epilog=example("yawrate dataset --episodes 1e6 --out big --workers 2"))
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    required=True,
    help="Folder to write, or to go on with.",
)
@click.option("--episodes", type=COUNT, help="How many; 1e6 is a million.")
@click.option(
    "--context",
    type=click.Choice(list(CONTEXT_SETS)),
    default="train",
    show_default=True,
    help="Family of episodes.",
)
@click.option(
    "--compressor",
    type=click.Choice(compressors.BY_NAME),
    default="laguerre",
    show_default=True,
    help="What the features are; laguerre's pole is one that suits a plant, response is what "
    "`yawrate train` takes by itself, for vehicles only.",
)
@click.option(
    "--vehicle", type=READABLE, help="A vehicle's TOML file, or a plant's. [default: the paper's]"
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Of the random episodes.",
)
@click.option("--shard-size", type=COUNT, help="Episodes in a file. [default: 4096, raw 512]")
@click.option("--raw", is_flag=True, help="Keep the recordings too.")
@click.option("--workers", type=COUNT, help="Processes. [default: one a core]")
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="A Dask scheduler's address, or local for a cluster of --workers.",
)
@click.option(
    "--verify",
    is_flag=True,
    help=f"Read every byte of a finished folder, and simulate {SAMPLE} episodes again.",
)
def command(
    out: Path, episodes: int | None, context: str, compressor: str, vehicle: Path | None,
    seed: int, shard_size: int | None, raw: bool, workers: int | None, scheduler: str | None,
    verify: bool,
) -> None:  # fmt: skip
    """Simulate a data set of episodes, on this machine's cores or on a cluster.

    An interrupted run is called again and goes on where it was.  A folder that holds
    fewer episodes grows to what is asked for; one that holds more is refused.

    A plant's module is found beside its TOML file, beside the folder, where the command
    runs, and by PYTHONPATH.
    """
    from tuners import data
    from tuners.cli.progress import Bars
    from yawrate_env.plant.entry import from_toml

    if verify and not out.is_dir():
        raise click.UsageError(f"{out} is not a folder.")
    if not verify and episodes is None:
        raise click.UsageError("Say how many: --episodes.")
    plant = None if vehicle is None else from_toml(vehicle)
    with Bars() as bars:
        if verify:
            found = data.verify(out, sample=SAMPLE, plant=plant, progress=bars)
        else:
            what = plant or (Task() if vehicle is None else vehicle_file.read(vehicle))
            found = data.generate(
                what, CONTEXT_SETS[context], _stage(plant, compressor), episodes or 0, seed,
                out, shard_size=shard_size, workers=workers, scheduler=scheduler, raw=raw,
                progress=bars,
            )  # fmt: skip
    click.echo(f"{out}: {len(found)} episodes{', intact' if verify else ''}")


def _stage(plant: "Plant | None", name: str) -> "FirstStage":
    """A compressor by name, set for vehicles or to suit a plant."""
    from tuners.tuner.training import compressor_named

    if plant is None:
        return compressors.compressor(name)
    if name == "response":
        raise click.UsageError("The frequencies of --compressor response are a vehicle's.")
    return compressor_named(plant, name)
