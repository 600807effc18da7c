"""Train a tuner on simulated episodes and save it.

python scripts/train.py ts-ff --episodes 1500 --seed 0 --out my.tuner
python scripts/train.py rl --episodes 20000 --algorithm sac --out my-rl.tuner
python scripts/train.py rl --plant my_plant:plant --out plant-rl.tuner
"""

import argparse
from functools import partial
from pathlib import Path

import tuners
from tuners import arguments, plants
from tuners.agents import rl_tuner as rl
from tuners.cli.plant import accuracy
from tuners.cli.progress import Bars
from tuners.features import BY_NAME
from tuners.trust.vehicle_calibration import EPISODES, calibrate
from tuners.tuner.training import CALIBRATION


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
        "--calibration", type=arguments.whole,
        help=f"episodes that calibrate its intervals, default {EPISODES}, a plant's {CALIBRATION}",
    )  # fmt: skip
    only = parser.add_argument_group("rl only")
    only.add_argument(
        "--plant", metavar="MODULE:ATTRIBUTE",
        help="for a plant of your own instead of vehicles (docs/plants.md)",
    )  # fmt: skip
    only.add_argument("--algorithm", choices=rl.ALGORITHMS, default="sac")
    only.add_argument("--compressor", choices=BY_NAME, default="laguerre")
    only.add_argument("--log", help="folder for TensorBoard")
    only.add_argument(
        "--checkpoint", type=Path,
        help="zip written on the way and resumed from; it holds pickles: use your own only",
    )  # fmt: skip
    args = parser.parse_args()
    if args.plant and (args.name != "rl" or args.env_kwargs):
        parser.error("--plant goes with rl, without --env-kwargs; for others use yawrate train")
    with Bars() as bars:
        agent = agent_for_plant if args.plant else agent_for_vehicles
        train = agent if args.name == "rl" else two_stage
        tuner = train(args, bars)
    tuner.save(args.out)
    print(f"{args.out}: {args.name}, {tuner.training}")
    if isinstance(tuner, plants.PlantTuner):
        print(accuracy(tuner, args.seed))


def agent_for_plant(args: argparse.Namespace, bars: Bars) -> plants.PlantTuner:
    from tuners.agents import training as rl_training

    return rl_training.train_plant(
        args.plant, settings(args), log=args.log, checkpoint=args.checkpoint,
        calibration=args.calibration or CALIBRATION, progress=bars,
    )  # fmt: skip


def agent_for_vehicles(args: argparse.Namespace, bars: Bars) -> rl.RLTuner:
    from tuners.agents import training as rl_training

    (*_, (_, tuner)) = rl_training.train(
        args.env_kwargs,
        settings(args),
        at=rl_training.tenths(settings(args).episodes) if args.checkpoint else (),
        log=args.log,
        checkpoint=args.checkpoint,
        progress=bars,
    )
    calibrate(tuner, episodes=args.calibration or EPISODES, progress=partial(bars, "calibrating"))
    return tuner


def two_stage(args: argparse.Namespace, bars: Bars) -> tuners.TwoStage:
    recipe = tuners.RECIPES[args.name]
    task = arguments.environment({"v_x": list(recipe.v_x), **args.env_kwargs}).task
    tuner = tuners.train(args.name, task, episodes=args.episodes, seed=args.seed, progress=bars)
    calibrate(tuner, episodes=args.calibration or EPISODES, progress=partial(bars, "calibrating"))
    return tuner


def settings(args: argparse.Namespace) -> rl.Training:
    return rl.Training(args.algorithm, args.compressor, args.episodes or 20_000, seed=args.seed)


if __name__ == "__main__":
    arguments.run(main)
