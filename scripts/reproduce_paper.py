"""Repeat the paper's experiment: train, test, and draw Table III and figures 4 to 8.

python scripts/reproduce_paper.py            # results/ and figures/, about two minutes

What every processor gives goes to results/ and figures/; times of answers and figure 7, which are
this machine's, to runs/.
"""

from pathlib import Path

import click

from studies import paper, readme
from studies.program import FOLDER, counted, folders, program, seed
from tuners.cli.progress import Bars


@program(__doc__)
@counted("--episodes", 1500, "For training and for the test.")
@seed(help="Of both.")
@folders
@click.option("--times", type=FOLDER, default=Path("runs"), help="Folder for times and figure 7.")
@click.option("--readme", "page", type=click.Path(path_type=Path), help="Page to update.")
def main(
    episodes: int, seed: int, results: Path, figures: Path, times: Path, page: Path | None
) -> None:
    with Bars() as bars:
        table = paper.reproduce(episodes, seed, results, figures, times, bars)
    if page:
        readme.update(page, results / "table3.md")
    print(table)


if __name__ == "__main__":
    main()
