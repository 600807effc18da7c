"""Measure how time and memory of a data set grow with its size.

python scripts/dataset_scale.py                                # 1e3 to 1e6, about 10 minutes
python scripts/dataset_scale.py --episodes 1e3 --episodes 1e4  # some sizes only

A size that is in results/datasets.json already is not measured again; --fresh does.
"""

import argparse
import json
from pathlib import Path

import arguments
from studies import dataset_scale, plots
from tuners.cli.progress import Bars
from yawrate_env.files import write_text

SIZES = (1_000, 10_000, 100_000, 1_000_000)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--episodes", type=arguments.whole, action="append", help="sizes")
    parser.add_argument("--fresh", action="store_true", help="forget earlier measurements")
    parser.add_argument("--folder", type=Path, help="where data sets go; else temporary files")
    parser.add_argument("--results", type=Path, default=Path("results"), help="folder for tables")
    parser.add_argument("--figures", type=Path, default=Path("figures"), help="folder for figures")
    args = parser.parse_args()
    store = args.results / "datasets.json"
    known = json.loads(store.read_text())["sizes"] if store.exists() and not args.fresh else []
    sizes = {size["episodes"]: dataset_scale.Size(**size) for size in known}
    wanted = [n for n in args.episodes or SIZES if n not in sizes]
    with Bars() as bars:
        for done, episodes in enumerate(wanted):
            bars("data sets", done, len(wanted))
            sizes[episodes] = dataset_scale.measure(episodes, args.folder)
            bars("data sets", done + 1, len(wanted))
    result = dataset_scale.report([sizes[n] for n in sorted(sizes)])
    args.results.mkdir(parents=True, exist_ok=True)
    args.figures.mkdir(parents=True, exist_ok=True)
    write_text(store, json.dumps(result, indent=1) + "\n")
    write_text(args.results / "datasets.md", dataset_scale.to_markdown(result))
    plots.save(dataset_scale.picture(result), args.figures / "datasets.png")
    print(dataset_scale.to_markdown(result))


if __name__ == "__main__":
    arguments.run(main)
