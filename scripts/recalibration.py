"""Keep gains right while friction walks and jumps: who does how well, beside the bound.

python scripts/recalibration.py               # results/recalibration.*, a quarter of an hour
python scripts/recalibration.py --filters     # rides the filters again, nothing else: 10 minutes
python scripts/recalibration.py --speed       # measures the environment's speed again, nothing else
"""

import json
from pathlib import Path

import click

from studies import recalibration, recalibration_agent, recalibration_page
from studies.program import FOLDER, counted, program, seed
from tuners.cli.progress import Bars
from yawrate_env.files import write_text


@program(__doc__)
@counted("--drives", 400, "Of 50 windows each.")
@counted("--faulty", 100, "Drives under each fault.")
@counted("--tuned", 4, "Drives on which tuners answer every window.")
@counted("--agents", 5, "Seeds of the agent.")
@counted("--windows", 20_000, "That each learns from.")
@click.option("--tuner", "names", multiple=True, default=("bb", "ts-ff-lag-vx"), help="Tuners.")
@seed(help="Of the drives.")
@counted("--batch", 256, "Drives in the environment whose speed is measured.")
@counted("--rounds", 30, "Of timing.")
@click.option("--filters", "again", is_flag=True, help="Ride the filters again, nothing else.")
@click.option("--speed", "timing", is_flag=True, help="Measure speed alone.")
@click.option("--results", type=FOLDER, default=Path("results"), help="Folder to write to.")
def main(
    drives: int,
    faulty: int,
    tuned: int,
    agents: int,
    windows: int,
    names: tuple[str, ...],
    seed: int,
    batch: int,
    rounds: int,
    again: bool,
    timing: bool,
    results: Path,
) -> None:
    results.mkdir(parents=True, exist_ok=True)
    stored = results / "recalibration.json"
    with Bars() as bars:
        if timing or again:
            found = json.loads(stored.read_text())
        else:
            found = recalibration.study(drives, tuned, seed, names, bars)
            found["learned"] = windows
            found["rows"] += recalibration_agent.rows(drives, windows, agents, seed, bars)
        if again:
            found["rows"] = recalibration.renewed(found["rows"], drives, seed)
        if not timing:
            found["faults"] = recalibration.faults(faulty, seed, bars)
    if timing or not again:
        found["speed"] = recalibration.speed(batch, rounds)
    write_text(stored, json.dumps(found, indent=1, allow_nan=False) + "\n")
    page = recalibration_page.page(found)
    write_text(results / "recalibration.md", page)
    print(page)


if __name__ == "__main__":
    main()
