"""How near to the bound, why not nearer, and when not to trust it: results/*.json and *.md.

python scripts/accuracy.py ratios     # every tuner's error over the Cramer-Rao bound
python scripts/accuracy.py trust      # faulty recordings, unusual ones, intervals
python scripts/accuracy.py budget     # what each stage of a tuner loses
python scripts/accuracy.py learning   # 100 to 100 000 training vehicles
python scripts/accuracy.py million    # the worst of a million episodes
python scripts/accuracy.py page       # results/accuracy.md from what is there

`learning` and `million` go on where an earlier call with the same --results was cut off.
"""

import argparse
import json
from collections.abc import Callable
from pathlib import Path

import arguments
import tuners
from studies import accuracy_page, budget, learning, million, ratios, readme, trusting
from studies.plots import save
from tuners.cli.progress import Bars
from yawrate_env.files import write_text


def of_ratios(args: argparse.Namespace, path: Path, bars: Bars) -> str:
    episodes, close = (args.episodes, args.episodes) if args.episodes else (1500, 20_000)
    rows = ratios.run(episodes, close, progress=bars)
    write_text(path, ratios.to_json(rows))
    return ratios.to_markdown(rows)


def of_trust(args: argparse.Namespace, path: Path, bars: Bars) -> str:
    players = {name: tuners.load(name) for name in args.tuner or ("ts-ff-lag", "ts-ff-lag-vx")}
    each = args.episodes or 200
    found = trusting.run(
        players, faults_each=each, episodes=5 * each, unusual_each=each, covered=25 * each,
        seed=args.seed, progress=bars,
    )  # fmt: skip
    write_text(path, json.dumps(found, indent=1) + "\n")
    return trusting.to_markdown(found)


def of_budget(args: argparse.Namespace, path: Path, bars: Bars) -> str:
    sizes = budget.Sizes(args.episodes or 1500, *(args.vehicles or ()))
    rows = budget.budget(sizes, progress=bars)
    write_text(path, budget.to_json(rows, sizes))
    return budget.to_markdown(rows)


def of_learning(args: argparse.Namespace, path: Path, bars: Bars) -> str:
    from studies import learning_plot

    rows = learning.learn(
        path, args.vehicles or learning.VEHICLES, args.episodes or 1500, progress=bars
    )
    args.figures.mkdir(parents=True, exist_ok=True)
    save(learning_plot.curves(rows), args.figures / "learning.png")
    return learning.to_markdown(rows)


def of_million(args: argparse.Namespace, path: Path, bars: Bars) -> str:
    players = {name: tuners.load(name) for name in ("ts-ff-lag", "ts-ff")}
    return million.to_markdown(
        million.run(players, args.episodes or 1_000_000, path, progress=bars)
    )


STUDIES: dict[str, Callable[[argparse.Namespace, Path, Bars], str]] = {
    "ratios": of_ratios,
    "trust": of_trust,
    "budget": of_budget,
    "learning": of_learning,
    "million": of_million,
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("study", choices=(*STUDIES, "page"))
    parser.add_argument(
        "--episodes", type=arguments.whole,
        help="to test on; default 1500, million 1000000, trust 200 of each kind",
    )  # fmt: skip
    parser.add_argument(
        "--vehicles", type=arguments.whole, nargs="+", metavar="M",
        help="training vehicles; default: budget 1500 20000, learning 100 to 100000",
    )  # fmt: skip
    parser.add_argument("--tuner", action="append", metavar="NAME", help="trust: whose")
    parser.add_argument("--seed", type=arguments.seed, default=1, help="trust: default 1")
    parser.add_argument("--results", type=Path, default=Path("results"), help="folder for tables")
    parser.add_argument("--figures", type=Path, default=Path("figures"), help="folder for pictures")
    parser.add_argument("--readme", type=Path, help="page: file whose table is brought up to date")
    args = parser.parse_args()
    if args.study == "budget" and args.vehicles and len(args.vehicles) != 2:
        parser.error("--vehicles: budget takes two numbers, the usual one and as many as it takes")
    args.results.mkdir(parents=True, exist_ok=True)
    if args.study == "page":
        write_text(args.results / "accuracy.md", accuracy_page.page(args.results))
        if args.readme:
            readme.update(args.readme, args.results / "ratios.md")
        return
    path = args.results / f"{args.study}.json"
    with Bars() as bars:
        text = STUDIES[args.study](args, path, bars)
    write_text(path.with_suffix(".md"), text)
    print(text)


if __name__ == "__main__":
    arguments.run(main)
