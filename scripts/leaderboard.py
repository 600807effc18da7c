"""Score the project's own policies, and make the leaderboard's page from all stored files.

python scripts/leaderboard.py          # results/leaderboard/*.json and results/leaderboard.md
python scripts/leaderboard.py --page   # the page alone, after a file came in
"""

from pathlib import Path

import click

from studies import leaderboard
from studies.program import FOLDER, counted, program
from tuners.cli.progress import Bars
from yawrate_env.files import write_text


@program(__doc__)
@counted("--seeds", 5, "Of the agent that is trained.")
@counted("--windows", 20_000, "That it learns from.")
@counted("--episodes", None, "For a trial: fewer than count.")
@click.option("--page", "only", is_flag=True, help="Make the page alone.")
@click.option("--results", type=FOLDER, default=Path("results"), help="Folder to write to.")
def main(seeds: int, windows: int, episodes: int | None, only: bool, results: Path) -> None:
    folder = results / "leaderboard"
    folder.mkdir(parents=True, exist_ok=True)
    if not only:
        with Bars() as bars:
            for entry in leaderboard.own(windows, seeds, episodes, bars):
                entry.save(folder)
    page = leaderboard.page(leaderboard.entries(folder))
    write_text(results / "leaderboard.md", page)
    print(page)


if __name__ == "__main__":
    main()
