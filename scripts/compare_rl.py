"""Train reinforcement-learning agents and compare them with the two-stage tuners.

python scripts/compare_rl.py                     # five seeds of each agent, about an hour
python scripts/compare_rl.py --agent sac-laguerre --seeds 1

Trained agents are kept in runs/rl and found again; results go to results/ and figures/.
"""

import argparse
from pathlib import Path

import arguments
from studies import comparison, curve_plots, plots
from tuners.cli.progress import Bars

AGENTS = ("sac-laguerre", "sac-armax", "td3-laguerre", "ppo-laguerre")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--agent", action="append", choices=AGENTS, help="default: all of them")
    parser.add_argument("--seeds", type=arguments.whole, default=5, help="default 5")
    parser.add_argument("--episodes", type=arguments.whole, default=20_000, help="default 20000")
    parser.add_argument("--folder", type=Path, default=Path("runs/rl"), help="trained agents")
    parser.add_argument("--results", type=Path, default=Path("results"))
    parser.add_argument("--figures", type=Path, default=Path("figures"))
    args = parser.parse_args()
    runs = [tuple(name.split("-")) for name in args.agent or AGENTS]
    with Bars() as bars:
        scores = comparison.compare(runs, args.seeds, args.episodes, args.folder, bars)
    comparison.write(scores, args.episodes, args.results)
    plots.save(curve_plots.learning_curves(scores), args.figures / "rl.png")
    print(comparison.to_markdown(scores, args.episodes))


if __name__ == "__main__":
    arguments.run(main)
