"""Tune recordings of closed loops: with the reference, with the old gains, with neither.

python scripts/closed_loops.py                   # 400 drives; 40 for the figure
python scripts/closed_loops.py --drives 40 --others 0

Results go to results/closed_loops.*.
"""

from pathlib import Path

import click

import tuners
from studies import closed_loops, closed_loops_page
from studies.program import FOLDER, counted, program, seed
from tuners.cli.arguments import COUNT


@program(__doc__)
@counted("--drives", 400, "Of vehicles that are as the tuner assumes; the first 40 are the figure.")
@click.option("--others", type=COUNT, default=40, help="Under each of the other conditions.")
@seed(help="Of the drives.")
@click.option("--tuner", default="ts-ff-lag-vx", help="Name or .tuner file.")
@click.option("--results", type=FOLDER, default=Path("results"), help="Folder for tables.")
def main(drives: int, others: int, seed: int, tuner: str, results: Path) -> None:
    tested = tuners.load(tuner)
    results.mkdir(parents=True, exist_ok=True)
    rows = closed_loops.study(tested, drives=drives, others=others, seed=seed)
    given = {"tuner": Path(tuner).stem, "drives": drives, "others": others, "seed": seed}
    closed_loops_page.write(rows, given, results)
    print((results / "closed_loops.md").read_text())


if __name__ == "__main__":
    main()
