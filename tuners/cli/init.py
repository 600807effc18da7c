"""``yawrate init``."""

from pathlib import Path

import click

from tuners.cli.arguments import Output, example
from yawrate_env import plants
from yawrate_env.files import write_text
from yawrate_env.vehicle import vehicle_file

VEHICLE = "vehicle"


@click.command(epilog=example("yawrate init --plant fopdt -o heater.toml"))
@click.option(
    "--plant",
    type=click.Choice([VEHICLE, *plants.NAMES]),
    default=VEHICLE,
    show_default=True,
    help="A vehicle; first or second order, or an integrator, plus dead time; a motor; a heater.",
)
@click.option(
    "-o", "--out", type=Output(".toml"), help="File to write. [default: car.toml or PLANT.toml]"
)
@click.option("--force", is_flag=True, help="Replace an existing file.")
def command(plant: str, out: Path | None, force: bool) -> None:
    """Write a plant's file to fill in: ranges of its parameters, each with a comment."""
    out = out or Path("car.toml" if plant == VEHICLE else f"{plant}.toml")
    if out.exists() and not force:
        raise click.UsageError(f"{out} exists. Choose another name, or give --force.")
    write_text(out, vehicle_file.example() if plant == VEHICLE else plants.template(plant))
    whose = "your vehicle's" if plant == VEHICLE else "your plant's"
    click.echo(f"{out}: enter {whose} values, then: yawrate train --vehicle {out}")
