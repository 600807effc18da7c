"""How near to the bound, why not nearer, and how bad at worst: results/*.json and *.md.

python scripts/accuracy.py budget                       # what each stage of a tuner loses
python scripts/accuracy.py learning                     # 100 to 100 000 training vehicles
python scripts/accuracy.py million --episodes 1000000   # the worst of a million episodes

`learning` and `million` go on where an earlier call with the same --results was cut off.
"""

import argparse
from pathlib import Path

import tuners
from tuners import arguments
from tuners.plots import save
from tuners.progress import Bars
from tuners.studies import budget, learning, million
from yawrate_env.files import write_text


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("study", choices=("budget", "learning", "million"))
    parser.add_argument(
        "--episodes", type=arguments.whole, help="to test on; default 1500, million 1000000"
    )
    parser.add_argument(
        "--vehicles", type=arguments.whole, nargs="+", metavar="M",
        help="training vehicles; default: budget 1500 20000, learning 100 to 100000",
    )  # fmt: skip
    parser.add_argument("--results", type=Path, default=Path("results"), help="folder for tables")
    parser.add_argument("--figures", type=Path, default=Path("figures"), help="folder for pictures")
    args = parser.parse_args()
    if args.study == "budget" and args.vehicles and len(args.vehicles) != 2:
        parser.error("--vehicles: budget takes two numbers, the usual one and as many as it takes")
    args.results.mkdir(parents=True, exist_ok=True)
    path = args.results / f"{args.study}.json"
    with Bars() as bars:
        if args.study == "budget":
            sizes = budget.Sizes(args.episodes or 1500, *(args.vehicles or ()))
            rows = budget.budget(sizes, progress=bars)
            write_text(path, budget.to_json(rows, sizes))
            text = budget.to_markdown(rows)
        elif args.study == "learning":
            from tuners.studies import learning_plot

            vehicles = args.vehicles or learning.VEHICLES
            rows = learning.learn(path, vehicles, args.episodes or 1500, progress=bars)
            text = learning.to_markdown(rows)
            args.figures.mkdir(parents=True, exist_ok=True)
            save(learning_plot.curves(rows), args.figures / "learning.png")
        else:
            players = {name: tuners.load(name) for name in ("ts-ff-lag", "ts-ff")}
            text = million.to_markdown(
                million.run(players, args.episodes or 1_000_000, path, progress=bars)
            )
    write_text(path.with_suffix(".md"), text)
    print(text)


if __name__ == "__main__":
    arguments.run(main)
