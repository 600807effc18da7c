"""Which unknowns would explain the paper's Table III?  results/unknowns.json, .md, a figure.

python scripts/unknowns.py
python scripts/unknowns.py --tried 1000 --draws 20

It goes on where an earlier call with the same --results was cut off.  Ten minutes.
"""

from pathlib import Path

from studies import plots, unknowns, unknowns_page
from studies.program import counted, folders, program, seed
from tuners.cli.progress import Bars
from yawrate_env.files import write_text

GRAY = 20
"""Test episodes of a gray box that is only looked at."""


@program(__doc__)
@counted("--vehicles", 1500, "Training vehicles of each setting.")
@counted("--episodes", 300, "Test episodes of each setting.")
@counted("--tried", 100, "Random settings whose gray box is looked at.")
@counted("--draws", 2, "Of these, the nearest, with learners.")
@counted("--passes", 2, "Around the nearest of all.")
@seed(help="Of the episodes and of the random settings.")
@folders
def main(
    vehicles: int, episodes: int, tried: int, draws: int, passes: int, seed: int, results: Path,
    figures: Path,
) -> None:  # fmt: skip
    results.mkdir(parents=True, exist_ok=True)
    path = results / "unknowns.json"
    with Bars() as bars:

        def made(settings: list[unknowns.Setting]) -> list[unknowns.Row]:
            return unknowns.study(settings, path, vehicles, episodes, seed, bars)

        rows = made(unknowns.nearest_gray_boxes(tried, draws, GRAY, seed, bars))
        for _ in range(passes):
            nearest = unknowns.Setting(**unknowns.nearest(rows)[0]["setting"])
            rows = made(unknowns.one_at_a_time(nearest))
        rows = made(unknowns.one_at_a_time(unknowns.Setting()))
    text = unknowns_page.page(rows, vehicles, episodes, seed)
    write_text(results / "unknowns.md", text)
    plots.save(unknowns_page.picture(rows), figures / "unknowns.png")
    print(text)


if __name__ == "__main__":
    main()
