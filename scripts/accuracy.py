"""How near to the bound, why not nearer, and when not to trust it: results/*.json and *.md.

python scripts/accuracy.py ratios     # every tuner's error over the Cramer-Rao bound
python scripts/accuracy.py trust      # faulty recordings, unusual ones, intervals
python scripts/accuracy.py budget     # what each stage of a tuner loses
python scripts/accuracy.py learning   # 100 to 100 000 training vehicles
python scripts/accuracy.py million    # the worst of a million episodes
python scripts/accuracy.py minimax    # trained for the worst case over the prior
python scripts/accuracy.py page       # results/accuracy.md from the tables of the others

`ratios --keep` makes only the rows that the stored table lacks; `learning` and `million` go on
where an earlier call with the same --results was cut off.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import click

import tuners
from studies import accuracy_page, budget, learning, million, minimax, ratios, readme, trusting
from studies.plots import save
from studies.program import counted, folders, program, seed
from tuners.cli.arguments import COUNT
from tuners.cli.progress import Bars
from yawrate_env.files import write_text


@dataclass(frozen=True, slots=True)
class Settings:
    """Arguments of a study; None for its own default."""

    episodes: int | None
    vehicles: tuple[int, ...]
    tuner: tuple[str, ...]
    seed: int
    figures: Path
    keep: bool


def of_ratios(given: Settings, path: Path, bars: Bars) -> str:
    few, many = (given.episodes, given.episodes) if given.episodes else (1500, 20_000)
    kept = ratios.from_json(path.read_text()) if given.keep and path.exists() else ()
    rows = ratios.run(few, many, progress=bars, kept=kept)
    write_text(path, ratios.to_json(rows))
    return ratios.to_markdown(rows)


def of_trust(given: Settings, path: Path, bars: Bars) -> str:
    players = {name: tuners.load(name) for name in given.tuner}
    each = given.episodes or 200
    found = trusting.run(
        players, faults_each=each, episodes=5 * each, unusual_each=each, covered=25 * each,
        seed=given.seed, progress=bars,
    )  # fmt: skip
    write_text(path, json.dumps(found, indent=1) + "\n")
    return trusting.to_markdown(found)


def of_budget(given: Settings, path: Path, bars: Bars) -> str:
    sizes = budget.Sizes(given.episodes or 1500, *given.vehicles)
    rows = budget.budget(sizes, progress=bars)
    write_text(path, budget.to_json(rows, sizes))
    return budget.to_markdown(rows)


def of_learning(given: Settings, path: Path, bars: Bars) -> str:
    from studies import learning_plot

    vehicles = given.vehicles or learning.VEHICLES
    rows = learning.learn(path, vehicles, given.episodes or 1500, progress=bars)
    save(learning_plot.curves(rows), given.figures / "learning.png")
    return learning.to_markdown(rows)


def of_million(given: Settings, path: Path, bars: Bars) -> str:
    players = {name: tuners.load(name) for name in ("ts-ff-lag", "ts-ff")}
    found = million.run(players, given.episodes or 1_000_000, path, progress=bars)
    return million.to_markdown(found)


def of_minimax(given: Settings, path: Path, bars: Bars) -> str:
    episodes = given.episodes or 6400
    rows = minimax.study(episodes, progress=bars)
    write_text(path, minimax.to_json(rows, episodes))
    return minimax.to_markdown(rows)


STUDIES: dict[str, Callable[[Settings, Path, Bars], str]] = {
    "ratios": of_ratios,
    "trust": of_trust,
    "budget": of_budget,
    "learning": of_learning,
    "million": of_million,
    "minimax": of_minimax,
}


@program(__doc__)
@click.argument("study", metavar="STUDY", type=click.Choice([*STUDIES, "page"]))
@counted(
    "--episodes", None, "Test episodes.  [default: 1500, million 1000000, trust 200 of each kind]"
)
@click.option(
    "--vehicles", type=COUNT, multiple=True, metavar="M",
    help="Training vehicles; may be repeated.  [default: budget 1500 and 20000, learning 100 to "
    "100000]",
)  # fmt: skip
@click.option(
    "--tuner", multiple=True, default=("ts-ff-lag", "ts-ff-lag-vx"), metavar="NAME",
    help="For trust; may be repeated.",
)  # fmt: skip
@seed(1, "For trust.")
@folders
@click.option("--keep", is_flag=True, help="For ratios: make only the rows that are missing.")
@click.option(
    "--readme", "front", type=click.Path(path_type=Path), help="For page: whose table to update."
)
def main(
    study: str,
    episodes: int | None,
    vehicles: tuple[int, ...],
    tuner: tuple[str, ...],
    seed: int,
    results: Path,
    figures: Path,
    keep: bool,
    front: Path | None,
) -> None:
    if study == "budget" and len(vehicles) not in (0, 2):
        raise click.UsageError("--vehicles: budget takes two numbers, the usual one and many.")
    results.mkdir(parents=True, exist_ok=True)
    if study == "page":
        write_text(results / "accuracy.md", accuracy_page.page(results))
        if front:
            readme.update(front, results / "ratios.md")
        return
    path = results / f"{study}.json"
    with Bars() as bars:
        text = STUDIES[study](Settings(episodes, vehicles, tuner, seed, figures, keep), path, bars)
    write_text(path.with_suffix(".md"), text)
    print(text)


if __name__ == "__main__":
    main()
