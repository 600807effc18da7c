"""Train a tuner on simulated episodes and save it.

python scripts/train.py ts-ff --episodes 1500 --seed 0 --out my.tuner
"""

import argparse

import tuners
from tuners import arguments
from tuners.progress import Bars


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("name", choices=tuners.RECIPES, help="which tuner")
    parser.add_argument("--episodes", type=arguments.whole, default=1500, help="default 1500")
    parser.add_argument("--seed", type=arguments.seed, default=0, help="default 0")
    parser.add_argument(
        "--out", type=arguments.output, required=True, help="file to write, *.tuner"
    )
    parser.add_argument(
        "--env-kwargs", type=arguments.environment_kwargs, default={}, metavar="JSON",
        help='conditions of the environment, e.g. \'{"v_x": 25}\'',
    )  # fmt: skip
    args = parser.parse_args()
    task = arguments.task(args.env_kwargs)
    with Bars() as bars:
        tuner = tuners.train(args.name, task, episodes=args.episodes, seed=args.seed, progress=bars)
    tuner.save(args.out)
    print(f"{args.out}: {args.name}, {tuner.training['used']} episodes used")


if __name__ == "__main__":
    arguments.run(main)
