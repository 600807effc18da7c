"""Tuners of ready process plants, on recordings that SciPy simulated, right ones and faulty ones.

python scripts/process_plants.py --plant fopdt
python scripts/process_plants.py --plant fopdt --arguments '{"tau_c": 20}' --as "fopdt, slow"

Any plant of `yawrate_env.plants` whose parameters are a gain K, lags T.. and a dead time L. The
plant is added to results/process_plants.*.
"""

from pathlib import Path
from typing import Any

import click

from studies import process_plants
from studies.program import FOLDER, Json, counted, program, seed
from tuners.cli.progress import Bars
from yawrate_env.plant.entry import find


@program(__doc__)
@click.option("--plant", required=True, help="Name in yawrate_env.plants, or module:attribute.")
@click.option("--arguments", type=Json(), default={}, metavar="JSON", help="Of the plant.")
@click.option("--as", "name", help="What the results call it.  [default: the plant's name]")
@counted("--recordings", 500, "Right recordings.")
@click.option(
    "--faulty", type=click.IntRange(min=0), default=200, help="Recordings with each fault."
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
    seed: int,
    results: Path,
    readme: Path | None,
) -> None:
    entry = plant if ":" in plant else f"yawrate_env.plants:{plant}"
    described = find(entry, arguments=arguments)
    with Bars() as bars:
        print(
            process_plants.run(
                described, name or plant, results, count=recordings, faulty=faulty, seed=seed,
                progress=bars, readme=readme,
            )
        )  # fmt: skip


if __name__ == "__main__":
    main()
