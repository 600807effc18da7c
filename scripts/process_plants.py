"""Tuners of ready process plants, on recordings that SciPy simulated, right ones and faulty ones.

python scripts/process_plants.py --plant fopdt
python scripts/process_plants.py --plant fopdt --arguments '{"tau_c": 20}' --as "fopdt, slow"
python scripts/process_plants.py --plant examples/plants/wide_lag.py --corners 400

Any plant whose parameters are a gain K, lags T.. and perhaps a dead time L. It is added to
results/process_plants.*, or with --corners to results/corners.*.
"""

import sys
from pathlib import Path
from typing import Any

import click

from studies import corners, process_plants
from studies.program import FOLDER, Json, counted, program, seed
from tuners.cli.progress import Bars
from yawrate_env.plant.entry import find


@program(__doc__)
@click.option(
    "--plant",
    required=True,
    help="Name in yawrate_env.plants, module:attribute, or a file with a plant.",
)
@click.option("--arguments", type=Json(), default={}, metavar="JSON", help="Of the plant.")
@click.option("--as", "name", help="What the results call it.  [default: the plant's name]")
@counted("--recordings", 500, "Right recordings.")
@click.option(
    "--faulty", type=click.IntRange(min=0), default=200, help="Recordings with each fault."
)
@click.option(
    "--corners",
    "in_corners",
    type=click.IntRange(min=1),
    help="Recordings in every corner of the prior instead, and in its middle.",
)
@seed(help="Of training and recordings.")
@click.option("--results", type=FOLDER, default=Path("results"), help="Folder for tables.")
@click.option("--readme", type=click.Path(exists=True, path_type=Path), help="Page to update.")
def main(
    plant: str,
    arguments: dict[str, Any],
    name: str | None,
    recordings: int,
    faulty: int,
    in_corners: int | None,
    seed: int,
    results: Path,
    readme: Path | None,
) -> None:
    entry = plant if ":" in plant else f"yawrate_env.plants:{plant}"
    if plant.endswith(".py"):
        file = Path(plant)
        if not file.is_file():
            raise click.UsageError(f"plant = {plant}: there is no such file. Check the name.")
        sys.path.insert(0, str(file.resolve().parent))
        entry, plant = f"{file.stem}:plant", file.stem
    described = find(entry, arguments=arguments)
    with Bars() as bars:
        if in_corners is not None:
            tuner = process_plants.trained(described, seed, bars)
            print(corners.write(tuner, name or plant, results, in_corners, seed, readme))
            return
        print(
            process_plants.run(
                described, name or plant, results, count=recordings, faulty=faulty, seed=seed,
                progress=bars, readme=readme,
            )
        )  # fmt: skip


if __name__ == "__main__":
    main()
