"""Measure what several logs of one vehicle are worth: pooling, validation, disagreement.

python scripts/several.py                     # 200 sets of each kind
python scripts/several.py --sets 20

Results go to results/several.*.
"""

from pathlib import Path

import click

import tuners
from studies import several, several_page
from studies.program import FOLDER, counted, program, seed
from tuners.cli.progress import Bars
from tuners.cli.tuning import DEFAULT, WITHOUT


@program(__doc__)
@counted("--sets", 200, "Of each kind.")
@seed(help="Of everything that is drawn.")
@click.option("--tuner", default=DEFAULT, help="Name or .tuner file of a learner.")
@click.option("--results", type=FOLDER, default=Path("results"), help="Folder, made if absent.")
def main(sets: int, seed: int, tuner: str, results: Path) -> None:
    results.mkdir(parents=True, exist_ok=True)
    black_box = tuners.load(WITHOUT, tuners.load(tuner).plant)
    with Bars() as bars:
        found = several.study(tuners.load(tuner), black_box, sets, seed, bars)
    given = {"tuner": Path(tuner).stem, "sets": sets, "seed": seed}
    several_page.write(*found, given, results)
    print((results / "several.md").read_text())


if __name__ == "__main__":
    main()
