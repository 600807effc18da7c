"""Score every tuner under the evaluation protocol: results/README.md and scoreboard.json.

python scripts/make_results.py
python scripts/make_results.py --policy my_agent:Fixed --results mine   # yours among them
"""

from dataclasses import replace
from pathlib import Path

import click

import tuners
from studies import results_page, scoreboard
from studies.program import FOLDER, counted, policies, program
from tuners.agents.policies import chosen
from tuners.cli.progress import Bars
from yawrate_env.env.yaw_rate_env import PITuningEnv


@program(__doc__)
@click.option(
    "--tuner", multiple=True, metavar="FILE",
    help="A .tuner file to score with those that the package ships; may be repeated.",
)  # fmt: skip
@policies
@counted("--episodes", scoreboard.PROTOCOL.episodes, "Of each set; with another number, a trial.")
@click.option("--results", type=FOLDER, default=Path("results"), help="Folder to write to.")
def main(
    tuner: tuple[str, ...],
    policy: tuple[str, ...],
    sb3: tuple[str, ...],
    algo: str | None,
    episodes: int,
    results: Path,
) -> None:
    players: dict[str, scoreboard.Policy] = {
        **scoreboard.available(),
        **{name: tuners.load(name) for name in tuner},
        **chosen(policy, sb3, algo, PITuningEnv()),
    }
    results.mkdir(parents=True, exist_ok=True)
    protocol = replace(scoreboard.PROTOCOL, episodes=episodes)
    with Bars() as bars:
        board = scoreboard.run(players, protocol, bars)
    results_page.write(board, protocol, results)
    first = protocol.context_sets[0]
    rows = [row for row in board if row.context_set == first]
    print(results_page.scores(rows, results_page.bound(protocol, first)))


if __name__ == "__main__":
    main()
