"""Repeat the paper's experiment: train, test, and draw Table III and figures 4 to 8.

python scripts/reproduce_paper.py            # results/ and figures/, about two minutes
"""

import argparse
from pathlib import Path

import arguments
from studies import paper, readme
from tuners.cli.progress import Bars


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--episodes", type=arguments.whole, default=1500, help="training and test, default 1500"
    )
    parser.add_argument("--seed", type=arguments.seed, default=0, help="default 0")
    parser.add_argument("--results", type=Path, default=Path("results"), help="folder for tables")
    parser.add_argument("--figures", type=Path, default=Path("figures"), help="folder for pictures")
    parser.add_argument("--readme", type=Path, help="file whose table is brought up to date")
    args = parser.parse_args()
    with Bars() as bars:
        table = paper.reproduce(args.episodes, args.seed, args.results, args.figures, bars)
    if args.readme:
        readme.update(args.readme, args.results / "table3.md")
    print(table)


if __name__ == "__main__":
    arguments.run(main)
