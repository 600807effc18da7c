"""Tuners off their design point, and one tuner over all speeds.

python scripts/off_design.py                     # 1500 episodes, every tuner
python scripts/off_design.py --episodes 100 --tuner gb --tuner my.tuner

Results go to results/off_design.* and results/schedule.*, pictures to figures/.
"""

import argparse
from pathlib import Path

import numpy as np

import arguments
import tuners
from studies import off_design, off_design_page, pictures, plots, schedule, schedule_page
from tuners.cli.progress import Bars
from yawrate_env.vehicle.task import Task

NAMES = ("ts-gbm", "ts-ff", "ts-gbm-lag", "ts-ff-lag", "ts-ff-lag-vx", "gb", "rl")
EDGES = [10.0, 13.0, 16.0, 19.0, 22.0, 25.0, 28.0, 31.0, 33.0]
SPEEDS = np.arange(10.0, 33.5).tolist()
CLAIMED = (20.0, 13.0, 30.0)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--episodes", type=arguments.whole, default=1500, help="default 1500")
    parser.add_argument("--seed", type=arguments.seed, default=0, help="of the test set, default 0")
    parser.add_argument(
        "--tuner", action="append", help="name or .tuner file; default: " + ", ".join(NAMES)
    )
    parser.add_argument("--every-speed", default="ts-ff-lag-vx", help="the tuner for all speeds")
    parser.add_argument("--results", type=Path, default=Path("results"))
    parser.add_argument("--figures", type=Path, default=Path("figures"))
    args = parser.parse_args()
    tested = {Path(name).stem: tuners.load(name) for name in args.tuner or NAMES}
    for folder in (args.results, args.figures):
        folder.mkdir(parents=True, exist_ok=True)
    run = {"episodes": args.episodes, "seed": args.seed}
    with Bars() as bars:
        cells = off_design.study(tested, Task(), **run, progress=bars)
        off_design_page.write(cells, args.seed, args.results)
        plots.save(pictures.off_design(cells), args.figures / "off_design.png")

        name, every = Path(args.every_speed).stem, tuners.load(args.every_speed)
        bins = schedule.accuracy(every, EDGES, **run, progress=bars)
        fixed = tuners.load("ts-ff-lag")
        prices = [schedule.price("ts-ff-lag", fixed, 20.0, **run, progress=bars)]
        prices += [schedule.price(name, every, v_x, **run, progress=bars) for v_x in CLAIMED]
    rows = [schedule.schedule(every, *v, SPEEDS) for v in schedule.vehicles(every.task.prior)]
    schedule_page.write(rows, bins, prices, args.episodes, args.seed, args.results)
    plots.save(pictures.schedule(rows, bins, prices), args.figures / "schedule.png")
    print((args.results / "off_design.md").read_text(), (args.results / "schedule.md").read_text())


if __name__ == "__main__":
    arguments.run(main)
