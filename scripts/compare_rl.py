"""Train reinforcement-learning agents and compare them with the two-stage tuners.

python scripts/compare_rl.py                     # five seeds of each agent, about an hour
python scripts/compare_rl.py --agent naf-laguerre --seeds 10
python scripts/compare_rl.py --offline --seeds 3 # agents that learn from Minari data sets, alone

Trained agents are kept in runs/rl and found again; results go to results/ and figures/, where those
of agents that are not asked for stay.
"""

from pathlib import Path

import click

from studies import comparison, curve_plots, plots
from studies.program import FOLDER, counted, folders, program
from tuners.cli.progress import Bars

AGENTS = ("naf-laguerre", "naf-plain-laguerre", "sac-laguerre", "td3-laguerre", "ppo-laguerre")


@program(__doc__)
@click.option("--agent", type=click.Choice(AGENTS), multiple=True, default=AGENTS)
@counted("--seeds", 5, "Of each agent.")
@counted("--episodes", 20_000, "Of each training.")
@click.option("--folder", type=FOLDER, default=Path("runs/rl"), help="Trained agents.")
@click.option("--offline", is_flag=True, help="Agents that learn from Minari data sets, alone.")
@folders
def main(
    agent: tuple[str, ...],
    seeds: int,
    episodes: int,
    folder: Path,
    offline: bool,
    results: Path,
    figures: Path,
) -> None:
    runs = [
        (algorithm, features) for algorithm, features in (name.rsplit("-", 1) for name in agent)
    ]
    with Bars() as bars:
        if offline:
            from studies.offline import scores as of_sets  # imports Minari, an extra

            scores = list(of_sets(episodes, seeds, bars))
        else:
            scores = comparison.compare(runs, seeds, episodes, folder, bars)
    scores = comparison.write(scores, results)
    plots.save(curve_plots.learning_curves(scores), figures / "rl.png")
    print(comparison.to_markdown(scores))


if __name__ == "__main__":
    main()
