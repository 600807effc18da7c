"""Train reinforcement-learning agents and compare them with the two-stage tuners.

python scripts/compare_rl.py                     # five seeds of each agent, about an hour
python scripts/compare_rl.py --agent naf-laguerre --seeds 10
python scripts/compare_rl.py --offline --seeds 3   # those that learn from Minari data sets, alone
python scripts/compare_rl.py --raw --seeds 1       # a transformer on raw samples, alone
python scripts/compare_rl.py --times               # processor time of rl and ts-ff-lag, alone

Trained agents are kept in runs/rl and found again; results go to results/ and figures/, where those
of agents that are not asked for stay.
"""

import json
from pathlib import Path

import click

from studies import comparison, curve_plots, plots
from studies.program import FOLDER, counted, folders, program
from tuners.cli.progress import Bars
from yawrate_env.files import write_text

AGENTS = ("naf-laguerre", "naf-plain-laguerre", "sac-laguerre", "td3-laguerre", "ppo-laguerre")


@program(__doc__)
@click.option("--agent", type=click.Choice(AGENTS), multiple=True, default=AGENTS)
@counted("--seeds", 5, "Of each agent.")
@counted("--episodes", 20_000, "Of each training.")
@click.option("--folder", type=FOLDER, default=Path("runs/rl"), help="Trained agents.")
@click.option("--offline", is_flag=True, help="Agents that learn from Minari data sets, alone.")
@click.option("--raw", is_flag=True, help="A transformer on raw samples, alone.")
@click.option("--times", is_flag=True, help="Processor time of rl and ts-ff-lag, alone.")
@folders
def main(
    agent: tuple[str, ...],
    seeds: int,
    episodes: int,
    folder: Path,
    offline: bool,
    raw: bool,
    times: bool,
    results: Path,
    figures: Path,
) -> None:
    runs = [
        (algorithm, features) for algorithm, features in (name.rsplit("-", 1) for name in agent)
    ]
    results.mkdir(parents=True, exist_ok=True)
    with Bars() as bars:
        if offline:
            from studies.offline import scores as of_sets  # imports Minari, an extra

            scores = list(of_sets(episodes, seeds, bars))
        elif times:
            found = json.dumps(comparison.times(episodes, bars), indent=1)
            write_text(results / comparison.TIMES, f"{found}\n")
            scores = []
        elif raw:
            from studies import transformer

            scores = [
                transformer.scored(episodes, seed, transformer.Settings(), bars)
                for seed in range(seeds)
            ]
        else:
            scores = comparison.compare(runs, seeds, episodes, folder, bars)
    scores = comparison.write(scores, results)
    drawn = [s for s in scores if s.name not in comparison.OTHERS]
    plots.save(curve_plots.learning_curves(drawn), figures / "rl.png")
    print(comparison.to_markdown(scores))


if __name__ == "__main__":
    main()
