"""Draw pictures again from stored results, after a change of their looks.

python scripts/redraw.py
python scripts/redraw.py rl datasets

Figures 4 to 8 and the margins (scripts/reproduce_paper.py), and pictures of plants, are drawn where
they are measured: their points are not stored with all digits.
"""

from pathlib import Path

import click

from studies import plots
from studies.program import folders, program
from studies.redrawn import PICTURES


@program(__doc__)
@click.argument("picture", nargs=-1, type=click.Choice(sorted(PICTURES)))
@folders
def main(picture: tuple[str, ...], results: Path, figures: Path) -> None:
    for name in picture or PICTURES:
        plots.save(PICTURES[name](results), figures / f"{name}.png")
        click.echo(figures / f"{name}.png")


if __name__ == "__main__":
    main()
