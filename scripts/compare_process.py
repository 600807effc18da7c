"""Train a tuner for a ready plant by default and judge it on recordings that SciPy simulates.

python scripts/compare_process.py sopdt --controller PIDF
python scripts/compare_process.py fopdt --controller PID --rule amigo --test 200

Figures go to results/processes.*.
"""

from pathlib import Path

import click

from studies import processes
from studies.program import FOLDER, counted, program, seed
from tuners.cli.progress import Bars
from yawrate_env import plants


@program(__doc__)
@click.argument("plant", type=click.Choice(plants.NAMES))
@click.option("--controller", default="PI", help="By its name in docs/controllers.md.")
@click.option("--rule", default="simc", help="Likewise.")
@counted("--test", 500, "Fresh plants, one recording each.")
@seed(help="Of training and recordings.")
@click.option("--results", type=FOLDER, default=Path("results"), help="Folder, made if absent.")
def main(plant: str, controller: str, rule: str, test: int, seed: int, results: Path) -> None:
    described = getattr(plants, plant)(controller=controller, rule=rule)
    with Bars() as bars:
        found = processes.study(described, plant, rule, test, seed, bars)
    print(processes.write(found, results))


if __name__ == "__main__":
    main()
