"""``yawrate init``."""

from pathlib import Path

import click

from tuners.cli.example import example
from tuners.cli.files import Output
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
@click.option("--force", is_flag=True, help="Replace a file that is there.")
def command(out: Path, force: bool) -> None:
    """Write a vehicle's file to fill in: the paper's, with a comment on every value."""
    if out.exists() and not force:
        raise click.UsageError(f"{out} exists. Choose another name, or give --force.")
    write_text(out, vehicle_file.example())
    click.echo(f"{out}: put in your vehicle's values, then: yawrate train --vehicle {out}")
