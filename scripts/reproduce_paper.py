"""Repeat the paper's experiment: train, test, and draw Table III and figures 4 to 8.

python scripts/reproduce_paper.py            # results/ and figures/, about two minutes
"""

from pathlib import Path

import click

from studies import paper, readme
from studies.program import counted, folders, program, seed
from tuners.cli.progress import Bars


@program(__doc__)
@counted("--episodes", 1500, "For training and for the test.")
@seed(help="Of both.")
@folders
@click.option("--readme", "page", type=click.Path(path_type=Path), help="Page to update.")
def main(episodes: int, seed: int, results: Path, figures: Path, page: Path | None) -> None:
    with Bars() as bars:
        table = paper.reproduce(episodes, seed, results, figures, bars)
    if page:
        readme.update(page, results / "table3.md")
    print(table)


if __name__ == "__main__":
    main()
