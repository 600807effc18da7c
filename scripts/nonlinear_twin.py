"""Ask what a linear twin costs when the vehicle is not linear, and how fast the other is.

python scripts/nonlinear_twin.py             # results/nonlinear.* and figures/, ten minutes
"""

import argparse
from pathlib import Path

import arguments
from studies import nonlinear, nonlinear_plots, nonlinear_speed, plots
from tuners.cli.progress import Bars
from yawrate_env.files import write_text


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--episodes", type=arguments.whole, default=1500, help="test, default 1500")
    parser.add_argument(
        "--training", type=arguments.whole, default=600, help="vehicles, default 600"
    )
    parser.add_argument("--seed", type=arguments.seed, default=0, help="default 0")
    parser.add_argument("--rounds", type=arguments.whole, default=30, help="of timing, default 30")
    parser.add_argument("--results", type=Path, default=Path("results"), help="folder for tables")
    parser.add_argument("--figures", type=Path, default=Path("figures"), help="folder for pictures")
    args = parser.parse_args()
    with Bars() as bars:
        speed = nonlinear_speed.measure(64, args.rounds, bars)
        scores = nonlinear.study(args.episodes, args.seed, bars, training=args.training)
    table = f"{nonlinear.to_markdown(scores)}\n{nonlinear_speed.to_markdown(speed)}"
    args.results.mkdir(parents=True, exist_ok=True)
    args.figures.mkdir(parents=True, exist_ok=True)
    write_text(args.results / "nonlinear.md", table)
    write_text(
        args.results / "nonlinear.json",
        nonlinear.to_json(scores, speed, args.training, args.seed),
    )
    plots.save(nonlinear_plots.overview(scores), args.figures / "nonlinear.png")
    print(table)


if __name__ == "__main__":
    arguments.run(main)
