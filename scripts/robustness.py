"""Find out who breaks where: learner, fitted plant, black box and ladder under faults.

python scripts/robustness.py                     # 100 recordings a kind and condition
python scripts/robustness.py --recordings 20 --tuner ts-ff-lag

Results go to results/robustness.*, pictures to figures/robustness*.png.
"""

from pathlib import Path

import click

import tuners
from studies import degree, plots, readme, robustness, robustness_page, robustness_plot
from studies.draws import task_of
from studies.players import CLIMBER
from studies.program import counted, folders, program, seed
from tuners.cli.progress import Bars
from yawrate_env.files import write_text


@program(__doc__)
@counted("--recordings", 100, "Of each kind under each condition.")
@seed(help="Of everything that is drawn.")
@click.option("--tuner", default=CLIMBER, help="Name or .tuner file of a learner.")
@click.option("--readme", "front", type=click.Path(path_type=Path), help="Page to update.")
@folders
def main(
    recordings: int, seed: int, tuner: str, front: Path | None, results: Path, figures: Path
) -> None:
    tested = tuners.load(tuner)
    task = task_of(tested.plant)
    results.mkdir(parents=True, exist_ok=True)
    with Bars() as bars:
        levels = degree.sweep(tested, task, count=recordings, seed=seed, progress=bars)
        rows = robustness.study(tested, task, count=recordings, seed=seed, progress=bars)
    given = {"tuner": Path(tuner).stem, "recordings": recordings, "seed": seed}
    robustness_page.write(rows, levels, given, results)
    plots.save(robustness_plot.degrees(levels), figures / "robustness_degree.png")
    plots.save(robustness_plot.kinds(rows), figures / "robustness.png")
    if front is not None:
        summary = robustness_page.summary(rows, given)
        write_text(front, readme.updated(front.read_text(), "robustness", summary))
    print((results / "robustness.md").read_text())


if __name__ == "__main__":
    main()
