"""Give tuners the same episodes and write what their gains do, one row an episode and tuner.

python scripts/evaluate.py --tuner ts-ff --tuner gb --episodes 100 --seed 1 --out rows.csv
python scripts/evaluate.py --tuner ts-ff --policy my.agent:make --sb3 model.zip --out rows.csv
"""

import argparse

import arguments
import tuners
from studies.table import row, to_markdown
from tuners.agents import policies
from tuners.cli.progress import Bars
from tuners.tuner.evaluation import evaluate, write_csv
from yawrate_env.vehicle.contexts import CONTEXT_SETS, context_set


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--tuner", action="append", default=[], metavar="NAME",
        help=f"a .tuner file or one of {', '.join(tuners.NAMES)}; may be repeated",
    )  # fmt: skip
    policies.add_arguments(parser)
    parser.add_argument("--episodes", type=arguments.whole, default=1500, help="default 1500")
    parser.add_argument("--seed", type=arguments.seed, default=0, help="default 0")
    parser.add_argument("--out", type=arguments.output, required=True, help="CSV file to write")
    parser.add_argument("--context", choices=CONTEXT_SETS, default="test", help="default test")
    parser.add_argument(
        "--batch", type=arguments.whole, default=1,
        help="episodes a tuner gets at a time; the default 1 times single answers",
    )  # fmt: skip
    parser.add_argument(
        "--env-kwargs", type=arguments.environment_kwargs, default={}, metavar="JSON",
        help='conditions of the environment, e.g. \'{"snr_db": 20}\' or \'{"nonlinear": true}\'',
    )  # fmt: skip
    args = parser.parse_args()
    if not (args.tuner or args.policy or args.sb3):
        parser.error("nothing to evaluate: give --tuner, --policy or --sb3")
    env = arguments.environment(args.env_kwargs)
    task, players = env.task, policies.chosen(args.policy, args.sb3, args.algo, env)
    with Bars() as bars:
        found = evaluate(
            {**{name: tuners.load(name, task) for name in args.tuner}, **players},
            task,
            context_set(args.context),
            episodes=args.episodes,
            seed=args.seed,
            batch=args.batch,
            progress=lambda done, of: bars("evaluating", done, of),
        )
    write_csv(args.out, found)
    print(to_markdown([row(e, task) for e in found]))


if __name__ == "__main__":
    arguments.run(main)
