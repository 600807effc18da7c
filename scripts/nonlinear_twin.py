"""Measure what a linear twin costs when the vehicle is not linear, and both twins' speed.

python scripts/nonlinear_twin.py             # results/nonlinear.* and figures/, ten minutes
"""

from pathlib import Path

import click

from studies import nonlinear, nonlinear_plots, nonlinear_speed, plots, readme
from studies.program import counted, folders, program, seed
from tuners.cli.progress import Bars
from yawrate_env.files import write_text


@program(__doc__)
@counted("--episodes", 1500, "For the test.")
@counted("--training", 600, "Vehicles for training.")
@seed(help="Of both.")
@counted("--rounds", 30, "Of timing.")
@folders
@click.option("--page", type=click.Path(path_type=Path), help="Page to update.")
def main(
    episodes: int,
    training: int,
    seed: int,
    rounds: int,
    results: Path,
    figures: Path,
    page: Path | None,
) -> None:
    with Bars() as bars:
        speed = nonlinear_speed.measure(64, rounds, bars)
        scores = nonlinear.study(episodes, seed, bars, training=training)
    table = f"{nonlinear.to_markdown(scores)}\n{nonlinear_speed.to_markdown(speed)}"
    results.mkdir(parents=True, exist_ok=True)
    write_text(results / "nonlinear.md", table)
    write_text(results / "nonlinear.json", nonlinear.to_json(scores, speed, training, seed))
    if page:
        write_text(page, readme.updated(page.read_text(), "nonlinear", nonlinear.summary(scores)))
    plots.save(nonlinear_plots.overview(scores), figures / "nonlinear.png")
    print(table)


if __name__ == "__main__":
    main()
