"""Measure how fast the batch environment serves episodes, beside its rivals.

python scripts/benchmark.py --num-envs 256 --rounds 20
"""

import argparse
import json
from pathlib import Path

from tuners import arguments, throughput
from tuners.progress import Bars
from yawrate_env.files import write_text


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--num-envs", type=arguments.whole, default=256, help="default 256")
    parser.add_argument("--rounds", type=arguments.whole, default=20, help="default 20")
    parser.add_argument("--results", type=Path, default=Path("results"), help="folder for tables")
    args = parser.parse_args()
    with Bars() as bars:
        result = throughput.measure(args.num_envs, args.rounds, bars)
    args.results.mkdir(parents=True, exist_ok=True)
    write_text(args.results / "benchmark.json", json.dumps(result, indent=1) + "\n")
    write_text(args.results / "benchmark.md", throughput.to_markdown(result))
    print(throughput.to_markdown(result))


if __name__ == "__main__":
    arguments.run(main)
