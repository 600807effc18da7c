"""Train a tuner of a plant with several inputs and outputs, and deceive it by one channel's gain.

python scripts/channels.py examples/plants/wood_berry.py

The plant is added to results/channels.*; two minutes.
"""

import sys
from pathlib import Path

import click

from studies import channels
from studies.program import FOLDER, counted, program, seed
from tuners.cli.progress import Bars
from yawrate_env.plant.entry import find


@program(__doc__)
@click.argument("plant", metavar="FILE.py", type=click.Path(exists=True, path_type=Path))
@counted("--recordings", 48, "Of each kind.")
@seed(help="Of training and recordings.")
@click.option("--results", type=FOLDER, default=Path("results"), help="Folder for tables.")
@click.option("--readme", type=click.Path(exists=True, path_type=Path), help="Page to update.")
def main(plant: Path, recordings: int, seed: int, results: Path, readme: Path | None) -> None:
    sys.path.insert(0, str(plant.resolve().parent))
    found = find(f"{plant.stem}:plant")
    with Bars() as bars:
        print(
            channels.run(
                found,
                plant.stem,
                results,
                count=recordings,
                seed=seed,
                progress=bars,
                readme=readme,
            )
        )


if __name__ == "__main__":
    main()
