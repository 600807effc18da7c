"""Measure the speed of every stage and tuner, beside rivals and the machine's limits.

python scripts/benchmark.py
python scripts/benchmark.py --batch 256 --rounds 3 --largest 1e4 --training 0

Tables are kept by machine: those of this one are replaced, those of others stay.
pysib and sippy_unipi take part where they are installed (the extra "benchmark").
"""

import json
from pathlib import Path

import click

from benchmarks import page, stages, stopwatch, throughput
from studies import plots
from studies.program import counted, folders, program
from tuners.cli.progress import Bars
from yawrate_env.files import write_text


@program(__doc__)
@counted("--batch", 1000, "Episodes at a time.")
@counted("--rounds", 10, "Turns of each contender.")
@counted("--largest", 100_000, "Largest data set.")
@click.option("--training", type=click.IntRange(0), default=1500, help="Episodes, 0 for none.")
@folders
def main(
    batch: int, rounds: int, largest: int, training: int, results: Path, figures: Path
) -> None:
    with Bars() as bars:
        result = {
            "commit": stopwatch.commit(),
            "versions": stopwatch.versions(),
            "batch": batch,
            "rounds": rounds,
            "stages": stages.stages(batch, rounds, bars),
            "page_faults": {n: throughput.page_faults(n) for n in sorted({*stages.BATCHES, batch})},
            "commands": stages.commands(rounds),
            "first_answer": stages.first_answer(),
            "first": stages.first_calls(),
            "growth": stages.growth_in_fresh_process(stages.decades(largest)),
            "training": stages.trainings(training, bars) if training else {},
        }
    results.mkdir(parents=True, exist_ok=True)
    every = page.stored(results / "benchmark.json") | {stopwatch.machine(): result}
    write_text(results / "benchmark.json", json.dumps(every, indent=1) + "\n")
    write_text(results / "benchmark.md", page.to_markdown(every))
    plots.save(page.picture(stopwatch.machine(), result), figures / "speed.png")
    print(page.to_markdown({stopwatch.machine(): result}))


if __name__ == "__main__":
    main()
