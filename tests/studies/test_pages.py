"""Every page in results/ is what its program writes from the numbers stored beside it."""

import json

import pytest
from recordings import ROOT

from benchmarks import page as benchmark_page
from studies import (
    accuracy_page,
    budget,
    channels,
    closed_loops_page,
    comparison,
    corners,
    dataset_scale,
    leaderboard,
    learning,
    million,
    minimax,
    mutations_page,
    nonlinear,
    nonlinear_speed,
    off_design_page,
    plants,
    printed,
    process_plants,
    ratios,
    readme,
    recalibration_page,
    results_page,
    robustness_page,
    schedule_page,
    several_page,
    table3,
    trusting,
    unknowns_page,
)
from studies.markdown import general, short, table
from studies.off_design import Accuracy, Cell
from studies.schedule import Bin, Price, Schedule
from studies.scoreboard import PROTOCOL, Estimate, Row

RESULTS = ROOT / "results"


def stored(name):
    return json.loads((RESULTS / f"{name}.json").read_text())


def accurate(found, kind):
    """A record that holds `Accuracy`."""
    both = {name: Accuracy(**found[name]) for name in ("phase_margin", "crossover")}
    return kind(**found | both)


def off_design():
    found = stored("off_design")
    cells = [accurate(cell, Cell) for cell in found["cells"]]
    return off_design_page.page(cells, found["conditions"]["seed"])


def schedule():
    found = stored("schedule")
    prices = [
        Price(p["tuner"], p["v_x"], [accurate(cell, Cell) for cell in p["cells"]])
        for p in found["wrong_speed"]
    ]
    return schedule_page.page(
        [Schedule(**row) for row in found["schedule"]],
        [accurate(b, Bin) for b in found["accuracy"]],
        prices, found["conditions"]["episodes"], found["conditions"]["seed"],
    )  # fmt: skip


def nonlinear_twin():
    found = stored("nonlinear")
    scores = [nonlinear.Score(**row) for row in found["rows"]]
    return f"{nonlinear.to_markdown(scores)}\n{nonlinear_speed.to_markdown(found['speed'])}"


def agents():
    scores = [comparison.Score(**row) for row in stored("rl")]
    timed = stored("rl_times") if (RESULTS / comparison.TIMES).exists() else None
    return comparison.to_markdown(scores, timed)


def scoreboard():
    estimates = ("reward", "regret", "score", "phase_margin", "crossover")
    rows = [
        Row(**row | {name: Estimate(**row[name]) for name in estimates})
        for row in stored("scoreboard")["rows"]
    ]
    return results_page.page(rows, PROTOCOL, results_page.others(RESULTS))


PAGES = {
    "table3": lambda: table3.page(stored("table3")["rows"]),
    "ratios": lambda: ratios.to_markdown([ratios.Entry(**row) for row in stored("ratios")]),
    "trust": lambda: trusting.to_markdown(stored("trust")),
    "budget": lambda: budget.to_markdown(stored("budget")["rows"]),
    "learning": lambda: learning.to_markdown(stored("learning")["rows"]),
    "million": lambda: million.to_markdown(stored("million")),
    "off_design": off_design,
    "schedule": schedule,
    "nonlinear": nonlinear_twin,
    "rl": agents,
    "datasets": lambda: dataset_scale.to_markdown(stored("datasets")),
    "benchmark": lambda: benchmark_page.to_markdown(stored("benchmark")),
    "plants": lambda: plants.page(stored("plants")),
    "process_plants": lambda: process_plants.page(stored("process_plants")),
    "channels": lambda: channels.page(stored("channels")),
    "accuracy": lambda: accuracy_page.page(RESULTS),
    "closed_loops": lambda: closed_loops_page.page(*closed_loops_page.read(stored("closed_loops"))),
    "recalibration": lambda: recalibration_page.page(stored("recalibration")),
    "leaderboard": lambda: leaderboard.page(leaderboard.entries(RESULTS / "leaderboard")),
    "several": lambda: several_page.page(stored("several")),
    "log_files": lambda: mutations_page.page(stored("log_files")),
    "robustness": lambda: robustness_page.page(*robustness_page.read(stored("robustness"))),
    "corners": lambda: corners.page(stored("corners")),
    "minimax": lambda: minimax.to_markdown(stored("minimax")["rows"]),
    "unknowns": lambda: unknowns_page.page(
        stored("unknowns")["rows"], **stored("unknowns")["sizes"]
    ),
    "README": scoreboard,
}


@pytest.mark.parametrize("name", PAGES)
def test_a_page_comes_from_its_numbers(name):
    assert PAGES[name]() == (RESULTS / f"{name}.md").read_text()


def test_all_pages_are_here():
    assert {path.stem for path in RESULTS.glob("*.md")} == set(PAGES)


def test_other_pages_show_the_tables_of_the_results():
    front, page = ((ROOT / name).read_text() for name in ("README.md", "docs/accuracy.md"))
    for text, name in ((front, "table3"), (page, "ratios")):
        assert readme.updated(text, name, (RESULTS / f"{name}.md").read_text()) == text
    rows, _, conditions = robustness_page.read(stored("robustness"))
    summary = robustness_page.summary(rows, conditions)
    assert readme.updated(page, "robustness", summary) == page
    guide = (ROOT / "docs" / "nonlinear.md").read_text()
    scores = [nonlinear.Score(**row) for row in stored("nonlinear")["rows"]]
    assert readme.updated(guide, "nonlinear", nonlinear.summary(scores)) == guide
    guide, results = ((ROOT / folder / "plants.md").read_text() for folder in ("docs", "results"))
    rows = [line for line in results.splitlines() if line.startswith("|")]
    assert len(rows) > 12 and set(rows) <= set(guide.splitlines())
    guide = (ROOT / "docs" / "matlab.md").read_text()
    assert readme.updated(guide, "matlab", printed.compared()) == guide
    guide = (ROOT / "docs" / "plants.md").read_text()
    summary = process_plants.overview(stored("process_plants"))
    assert readme.updated(guide, "process_plants", summary) == guide
    (part,) = stored("channels").values()
    assert readme.updated(guide, "channels", channels.rows_of(part)) == guide
    (part,) = stored("corners").values()
    assert readme.updated(guide, "corners", corners.section(part)) == guide


def test_a_page_without_markers_is_refused():
    page = "a <!-- x:start --> old <!-- x:end --> b"
    new = "a <!-- x:start -->\n| new |\n<!-- x:end --> b"
    assert readme.updated(page, "x", "| new |\n") == new
    for broken in ("", page.replace("start", "begin"), page.replace("x:end", "end")):
        with pytest.raises(ValueError, match="x:start"):
            readme.updated(broken, "x", "| new |")


def test_tables_and_numbers():
    assert table(("a", "b"), [(1, "x y")]) == "| a | b |\n|---|---|\n| 1 | x y |\n"
    with pytest.raises(ValueError, match="argument"):
        table(("a", "b"), [(1,)])
    values = 0.0, 1234.5, 60.02, 0.17144, 0.0031999, 3e-9, float("nan")
    texts = "0", "1234", "60.0", "0.171", "0.00320", "3e-09", "nan"  # three digits
    assert tuple(map(short, values)) == texts
    assert (general(None), general(1.2345), general(0.5, 2.0)) == ("–", "1.23", "0.5 (2)")
