"""``yawrate init``."""

from pathlib import Path

import click

from tuners.cli.arguments import Output, example
from yawrate_env.files import write_text
from yawrate_env.vehicle import vehicle_file


@click.command(epilog=example("yawrate init -o car.toml"))
@click.option(
    "-o",
    "--out",
    type=Output(".toml"),
    default="car.toml",
    show_default=True,
    help="File to write.",
)
@click.option("--force", is_flag=True, help="Replace an existing file.")
def command(out: Path, force: bool) -> None:
    """Write a vehicle's file to fill in: the paper's values, each with a comment."""
    if out.exists() and not force:
        raise click.UsageError(f"{out} exists. Choose another name, or give --force.")
    write_text(out, vehicle_file.example())
    click.echo(f"{out}: enter your vehicle's values, then: yawrate train --vehicle {out}")
