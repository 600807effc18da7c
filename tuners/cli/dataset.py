"""``yawrate dataset``."""

from pathlib import Path

import click

from tuners import vehicle_file
from tuners.cli.example import example
from tuners.cli.files import READABLE
from yawrate_env.task import Task


@click.command(epilog=example("yawrate dataset --episodes 100000 --out episodes --workers 2"))
@click.option("--episodes", type=click.IntRange(min=1), required=True, help="How many.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    required=True,
    help="Folder to write.",
)
@click.option("--scheduler", help="Address of a Dask scheduler, instead of this machine's cores.")
@click.option("--workers", type=click.IntRange(min=1), help="Processes. [default: one a core]")
@click.option("--verify", is_flag=True, help="Check a folder against its own record.")
@click.option("--vehicle", type=READABLE, help="A vehicle's TOML file. [default: the paper's]")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Of the random vehicles.",
)
@click.option(
    "--shard-size",
    type=click.IntRange(min=1),
    default=1000,
    show_default=True,
    help="Episodes in a file.",
)
@click.option("--raw", is_flag=True, help="Keep the recordings, not the features alone.")
def command(
    episodes: int, out: Path, scheduler: str | None, workers: int | None, verify: bool,
    vehicle: Path | None, seed: int, shard_size: int, raw: bool,
) -> None:  # fmt: skip
    """Simulate a data set of episodes, on this machine or on many."""
    from tuners import data

    task = Task() if vehicle is None else vehicle_file.read(vehicle)
    data.generate(
        task, episodes, out, scheduler=scheduler, workers=workers, verify=verify, seed=seed,
        shard_size=shard_size, raw=raw,
    )  # fmt: skip
