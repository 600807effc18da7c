"""Evaluate tuners off their design point, and one tuner over all speeds; learners alone.

python scripts/off_design.py                     # 1500 episodes, every tuner
python scripts/off_design.py --episodes 100 --tuner gb --tuner my.tuner
python scripts/off_design.py --keep --tuner bb   # anew, beside the stored rows of others

Results go to results/off_design.* and results/schedule.*, pictures to figures/.
"""

from pathlib import Path

import click
import numpy as np

from studies import off_design, off_design_page, pictures, plots, schedule, schedule_page
from studies.players import CLIMBER, LADDER, named
from studies.program import counted, folders, program, seed
from tuners.cli.progress import Bars
from yawrate_env.vehicle.task import Task

NAMES = (
    "ts-gbm", "ts-ff", "ts-gbm-lag", "ts-ff-lag", "ts-ff-lag-vx", "rl", "gb", "bb", "vrft", "frit",
    LADDER,
)  # fmt: skip
EDGES = [10.0, 13.0, 16.0, 19.0, 22.0, 25.0, 28.0, 31.0, 33.0]
SPEEDS = np.arange(10.0, 33.5).tolist()
CLAIMED = (20.0, 13.0, 30.0)


@program(__doc__)
@counted("--episodes", 1500, "Of the test set.")
@seed()
@click.option("--tuner", multiple=True, default=NAMES, help="Name or .tuner file, or 'ladder'.")
@click.option("--keep", is_flag=True, help="Stored rows of other tuners; no schedule.")
@click.option("--every-speed", default="ts-ff-lag-vx", help="The tuner for all speeds.")
@folders
def main(
    episodes: int,
    seed: int,
    tuner: tuple[str, ...],
    keep: bool,
    every_speed: str,
    results: Path,
    figures: Path,
) -> None:
    tested = {Path(name).stem: named(name) for name in tuner}
    name, every = Path(every_speed).stem, named(every_speed)
    results.mkdir(parents=True, exist_ok=True)
    with Bars() as bars:
        cells = off_design.study(tested, Task(), episodes=episodes, seed=seed, progress=bars)
        if keep:
            cells = off_design_page.joined(results, cells, seed)
        off_design_page.write(cells, seed, results)
        plots.save(pictures.off_design(cells), figures / "off_design.png")
        if keep:
            return
        bins = schedule.accuracy(every, EDGES, episodes=episodes, seed=seed, progress=bars)
        prices = [
            schedule.price(who, of, v_x, episodes=episodes, seed=seed, progress=bars)
            for who, of, v_x in (
                (CLIMBER, named(CLIMBER), 20.0),
                *((name, every, v_x) for v_x in CLAIMED),
            )
        ]
    rows = [schedule.schedule(every, *v, SPEEDS) for v in schedule.vehicles(every.plant)]
    schedule_page.write(rows, bins, prices, episodes, seed, results)
    plots.save(pictures.schedule(rows, bins, prices), figures / "schedule.png")
    for page in ("off_design.md", "schedule.md"):
        print((results / page).read_text())


if __name__ == "__main__":
    main()
