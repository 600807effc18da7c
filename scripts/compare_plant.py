"""Train a tuner for a plant of your own and compare it with reference tuners.

python scripts/compare_plant.py examples/plants/dc_motor.py
python scripts/compare_plant.py my_package.my_plant:plant --test 200

A path ending in .py is a file with an attribute `plant`.  The plant is added to
results/plants.*, and its picture goes to figures/.
"""

import sys
from pathlib import Path

import click

from studies import plants
from studies.program import counted, folders, program, seed
from tuners.cli.arguments import COUNT
from tuners.cli.progress import Bars
from yawrate_env.plant.entry import find


@program(__doc__)
@click.argument("plant", metavar="PLANT")
@click.option(
    "--plants", "count", type=COUNT, help="Simulated for training.  [default: the plant's recipe's]"
)
@counted("--test", 500, "Test episodes, 20 or more.")
@seed(help="Of training and test.")
@click.option(
    "--page",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="A page with a place for the plant's table, which is put there.",
)
@folders
def main(
    plant: str,
    count: int | None,
    test: int,
    seed: int,
    page: Path | None,
    results: Path,
    figures: Path,
) -> None:
    entry = plant
    if plant.endswith(".py"):
        file = Path(plant)
        if not file.is_file():
            raise click.UsageError(f"plant = {plant}: there is no such file. Check the name.")
        sys.path.insert(0, str(file.resolve().parent))
        entry = f"{file.stem}:plant"
    described = find(entry)
    name = entry.partition(":")[0].rpartition(".")[2]
    with Bars() as bars:
        print(
            plants.run(
                described, name, results, figures, count=count, test=test, seed=seed,
                progress=bars, page=page,
            )
        )  # fmt: skip


if __name__ == "__main__":
    main()
