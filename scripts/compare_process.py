"""Train a tuner for a ready plant by default and judge it on recordings that SciPy simulates.

python scripts/compare_process.py sopdt --controller PIDF
python scripts/compare_process.py fopdt --controller PID --rule amigo --test 200

python scripts/compare_process.py sopdt --controller PIDF --tuner my.tuner

Figures go to results/processes.*.
"""

import time
from pathlib import Path

import click

import tuners
from studies import processes
from studies.program import FOLDER, counted, program, seed
from tuners.cli.arguments import READABLE
from tuners.cli.progress import Bars
from yawrate_env import plants


@program(__doc__)
@click.argument("plant", type=click.Choice(plants.NAMES))
@click.option("--controller", default="PI", help="By its name in docs/controllers.md.")
@click.option("--rule", default="simc", help="Likewise.")
@counted("--test", 500, "Fresh plants, one recording each.")
@seed(help="Of training and recordings.")
@click.option("--tuner", type=READABLE, help="Of that plant, trained already.")
@click.option("--results", type=FOLDER, default=Path("results"), help="Folder, made if absent.")
def main(
    plant: str,
    controller: str,
    rule: str,
    test: int,
    seed: int,
    tuner: Path | None,
    results: Path,
) -> None:
    described = getattr(plants, plant)(controller=controller, rule=rule)
    started = time.perf_counter()
    if tuner is None:
        with Bars() as bars:
            trained = tuners.train(described, seed=seed, progress=bars)
    else:
        trained = tuners.load(tuner, described)
    seconds = time.perf_counter() - started if tuner is None else float("nan")
    print(processes.write(processes.study(trained, plant, rule, test, seed, seconds), results))


if __name__ == "__main__":
    main()
