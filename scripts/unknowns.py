"""Which unknowns would explain the paper's Table III?  results/unknowns.json, .md, a figure.

python scripts/unknowns.py             # every setting one at a time, then 30 at random
python scripts/unknowns.py --draws 100

It goes on where an earlier call with the same --results was cut off.  Ten minutes.
"""

from pathlib import Path

import click

from studies import plots, unknowns, unknowns_page
from studies.program import counted, folders, program, seed
from tuners.cli.progress import Bars
from yawrate_env.files import write_text


@program(__doc__)
@counted("--vehicles", 1500, "Training vehicles of each setting.")
@counted("--episodes", 300, "Test episodes of each setting.")
@click.option("--draws", type=click.IntRange(0), default=30, help="Random settings.")
@seed(help="Of the episodes and of the random settings.")
@folders
def main(vehicles: int, episodes: int, draws: int, seed: int, results: Path, figures: Path) -> None:
    results.mkdir(parents=True, exist_ok=True)
    settings = [*unknowns.one_at_a_time(), *unknowns.at_random(draws, seed)]
    settings = list(dict.fromkeys(settings))
    with Bars() as bars:
        rows = unknowns.study(
            settings, results / "unknowns.json", vehicles, episodes, seed, bars
        )  # fmt: skip
    text = unknowns_page.page(rows, vehicles, episodes, seed)
    write_text(results / "unknowns.md", text)
    plots.save(unknowns_page.picture(rows), figures / "unknowns.png")
    print(text)


if __name__ == "__main__":
    main()
