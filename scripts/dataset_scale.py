"""Measure how time and memory of a data set grow with its size.

python scripts/dataset_scale.py                                # 1e3 to 1e6, about 10 minutes
python scripts/dataset_scale.py --episodes 1e3 --episodes 1e4  # some sizes only

A size that is in results/datasets.json already is not measured again; --fresh does.
"""

import json
from pathlib import Path

import click

from studies import dataset_scale, plots
from studies.program import FOLDER, folders, program
from tuners.cli.arguments import COUNT
from tuners.cli.progress import Bars
from yawrate_env.files import write_text

SIZES = (1_000, 10_000, 100_000, 1_000_000)


@program(__doc__)
@click.option("--episodes", type=COUNT, multiple=True, default=SIZES, help="Sizes.")
@click.option("--fresh", is_flag=True, help="Forget earlier measurements.")
@click.option("--folder", type=FOLDER, help="Where data sets go; else temporary files.")
@folders
def main(
    episodes: tuple[int, ...], fresh: bool, folder: Path | None, results: Path, figures: Path
) -> None:
    store = results / "datasets.json"
    known = json.loads(store.read_text())["sizes"] if store.exists() and not fresh else []
    sizes = {size["episodes"]: dataset_scale.Size(**size) for size in known}
    missing = [n for n in episodes if n not in sizes]
    with Bars() as bars:
        for done, count in enumerate(missing):
            bars("data sets", done, len(missing))
            sizes[count] = dataset_scale.measure(count, folder)
            bars("data sets", done + 1, len(missing))
    result = dataset_scale.report([sizes[n] for n in sorted(sizes)])
    results.mkdir(parents=True, exist_ok=True)
    write_text(store, json.dumps(result, indent=1) + "\n")
    write_text(results / "datasets.md", dataset_scale.to_markdown(result))
    plots.save(dataset_scale.picture(result), figures / "datasets.png")
    print(dataset_scale.to_markdown(result))


if __name__ == "__main__":
    main()
