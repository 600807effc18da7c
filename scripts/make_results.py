"""Score every tuner under the evaluation protocol: results/README.md and scoreboard.json.

python scripts/make_results.py
python scripts/make_results.py --policy my_agent:Fixed --results mine   # yours among them
"""

import argparse
from dataclasses import replace
from pathlib import Path

import arguments
import tuners
from studies import results_page, scoreboard
from tuners.agents import policies
from tuners.cli.progress import Bars
from yawrate_env.env.yaw_rate_env import PITuningEnv


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--tuner", action="append", default=[], metavar="FILE",
        help="a .tuner file beside the tuners that the package ships; may be repeated",
    )  # fmt: skip
    policies.add_arguments(parser)
    parser.add_argument(
        "--episodes", type=arguments.whole, default=scoreboard.PROTOCOL.episodes,
        help="of each context set; other than the default %(default)s it is a trial",
    )  # fmt: skip
    parser.add_argument("--results", type=Path, default=Path("results"), help="folder to write to")
    args = parser.parse_args()
    args.results.mkdir(parents=True, exist_ok=True)
    players: dict[str, scoreboard.Policy] = {
        **scoreboard.available(),
        **{name: tuners.load(name) for name in args.tuner},
        **policies.chosen(args.policy, args.sb3, args.algo, PITuningEnv()),
    }
    protocol = replace(scoreboard.PROTOCOL, episodes=args.episodes)
    with Bars() as bars:
        board = scoreboard.run(players, protocol, bars)
    results_page.write(board, protocol, args.results)
    first = protocol.context_sets[0]
    shown = [row for row in board if row.context_set == first]
    print(results_page.table(shown, results_page.bound(protocol, first)))


if __name__ == "__main__":
    arguments.run(main)
