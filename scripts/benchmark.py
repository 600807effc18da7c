"""Measure the speed of every stage and tuner, beside rivals and the machine's limits.

python scripts/benchmark.py
python scripts/benchmark.py --batch 256 --rounds 3 --largest 1e4 --training 0

pysib and sippy_unipi take part where they are installed (the extra "benchmark").
"""

import argparse
import json
from pathlib import Path

import arguments
from benchmarks import page, stages, stopwatch
from studies import plots
from tuners.cli.progress import Bars
from yawrate_env.files import write_text


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    whole, seed = arguments.whole, arguments.seed
    parser.add_argument("--batch", type=whole, default=1000, help="episodes at a time (1000)")
    parser.add_argument("--rounds", type=whole, default=10, help="turns of each contender (10)")
    parser.add_argument("--largest", type=whole, default=100_000, help="largest data set (1e5)")
    parser.add_argument("--training", type=seed, default=1500, help="episodes, 0: none (1500)")
    parser.add_argument("--results", type=Path, default=Path("results"), help="folder for tables")
    parser.add_argument("--figures", type=Path, default=Path("figures"), help="folder for pictures")
    args = parser.parse_args()
    with Bars() as bars:
        result = {
            "machine": stopwatch.machine(),
            "versions": stopwatch.versions(),
            "batch": args.batch,
            "rounds": args.rounds,
            "stages": stages.stages(args.batch, args.rounds, bars),
            "first": stages.first_calls(),
            "growth": stages.growth_in_fresh_process(stages.decades(args.largest)),
            "training": stages.trainings(args.training, bars) if args.training else {},
        }
    for folder in (args.results, args.figures):
        folder.mkdir(parents=True, exist_ok=True)
    write_text(args.results / "benchmark.json", json.dumps(result, indent=1) + "\n")
    write_text(args.results / "benchmark.md", page.to_markdown(result))
    plots.save(page.picture(result), args.figures / "speed.png")
    print(page.to_markdown(result))


if __name__ == "__main__":
    arguments.run(main)
