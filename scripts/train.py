"""Train a tuner on simulated episodes and save it.

python scripts/train.py ts-ff --episodes 1500 --seed 0 --out my.tuner
python scripts/train.py rl --episodes 20000 --algorithm sac --out my-rl.tuner
"""

import argparse
from functools import partial
from pathlib import Path

import tuners
from tuners import arguments, rl
from tuners.calibration import EPISODES, calibrate
from tuners.progress import Bars


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("name", choices=[*tuners.RECIPES, "rl"], help="which tuner")
    parser.add_argument("--episodes", type=arguments.whole, help="default: the recipe's, rl 20000")
    parser.add_argument("--seed", type=arguments.seed, default=0, help="default 0")
    parser.add_argument("--out", type=arguments.model, required=True, help="file to write, *.tuner")
    parser.add_argument(
        "--env-kwargs", type=arguments.environment_kwargs, default={}, metavar="JSON",
        help='conditions of the environment, e.g. \'{"v_x": 25}\' or \'{"nonlinear": true}\'',
    )  # fmt: skip
    parser.add_argument(
        "--calibration", type=arguments.whole, default=EPISODES,
        help="episodes that calibrate its intervals, default %(default)s",
    )  # fmt: skip
    agent = parser.add_argument_group("rl only")
    agent.add_argument("--algorithm", choices=rl.ALGORITHMS, default="sac")
    agent.add_argument("--compressor", choices=("laguerre", "armax"), default="laguerre")
    agent.add_argument("--log", help="folder for TensorBoard")
    agent.add_argument(
        "--checkpoint", type=Path,
        help="zip written on the way and resumed from; it holds pickles: use your own only",
    )  # fmt: skip
    args = parser.parse_args()
    tuner: tuners.TwoStage | rl.RLTuner
    with Bars() as bars:
        if args.name == "rl":
            settings = rl.Training(
                args.algorithm, args.compressor, args.episodes or 20_000, seed=args.seed
            )
            step = max(settings.episodes // 10, 1)
            from tuners import rl_training

            (*_, (_, tuner)) = rl_training.train(
                args.env_kwargs,
                settings,
                at=tuple(range(step, settings.episodes, step)) if args.checkpoint else (),
                log=args.log,
                checkpoint=args.checkpoint,
                progress=bars,
            )
        else:
            recipe = tuners.RECIPES[args.name]
            task = arguments.environment({"v_x": list(recipe.v_x), **args.env_kwargs}).task
            tuner = tuners.train(
                args.name, task, episodes=args.episodes, seed=args.seed, progress=bars
            )
        calibrate(tuner, episodes=args.calibration, progress=partial(bars, "calibrating"))
    tuner.save(args.out)
    print(f"{args.out}: {args.name}, {tuner.training}")


if __name__ == "__main__":
    arguments.run(main)
