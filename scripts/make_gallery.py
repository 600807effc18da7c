"""Run the plants of docs/gallery.md: record each, tune it by its gray box, draw and write the page.

python scripts/make_gallery.py

Nothing is trained; half a minute.
"""

from pathlib import Path

import click

from studies import gallery
from studies.program import FOLDER, program

ROOT = Path(__file__).parents[1]


@program(__doc__)
@click.option("--page", type=click.Path(path_type=Path), default=Path("docs/gallery.md"))
@click.option("--figures", type=FOLDER, default=Path("figures"), help="Folder for pictures.")
def main(page: Path, figures: Path) -> None:
    gallery.run(gallery.EXHIBITS, ROOT / "examples" / "plants", page, figures)


if __name__ == "__main__":
    main()
