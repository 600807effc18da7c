"""Table III: its rows, its JSON and its Markdown."""

import json

import numpy as np
import pytest

from studies.metrics import bootstrap_interval
from studies.table import PAPER, bound_row, row, to_json, to_markdown
from tuners.tuner.evaluation import Evaluation
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Task

PHASES = np.array([59.0, 61.0, 60.5, np.nan, 59.5])
CROSSOVERS = np.array([1.49, 1.52, 1.5, np.nan, 1.48])


def evaluation(tuner="ts-ff"):
    context = Context.of([0.4, 0.6, 0.8, 1.0, 0.5], [0.0, 100.0, 200.0, 300.0, 50.0], 20.0)
    truth = loops(Task(), context).design()
    stable = np.array([True, True, True, False, False])
    seconds = np.array([1e-3, 2e-3, 9.0, 1e-3, 4e-3])
    return Evaluation(
        tuner, context, 1.1 * truth.kp, 0.8 * truth.Ti, PHASES, CROSSOVERS, stable, seconds
    )


def test_a_rows_numbers():
    found = row(evaluation(), Task())
    assert (found["tuner"], found["episodes"], found["unstable"]) == ("ts-ff", 5, 2)
    for name, values, target in (("phase_margin", PHASES, 60.0), ("crossover", CROSSOVERS, 1.5)):
        values = values[np.isfinite(values)]
        statistics = found[name]
        assert statistics["mean"] == pytest.approx(values.mean())
        assert statistics["std"] == pytest.approx(values.std())
        assert statistics["rmse"] == pytest.approx(np.sqrt(np.mean((values - target) ** 2)))
        assert statistics["mean_interval"] == bootstrap_interval(values, np.mean)
        assert statistics["std_interval"] == bootstrap_interval(values, np.std)
    assert found["rms_percent"] == pytest.approx({"kp": 10.0, "Ti": 20.0})
    assert found["median_seconds"] == 2e-3


def test_the_papers_values_stand_beside_its_own_tuners():
    # Table III as printed.
    expected = {
        "gb": ((59.98, 0.2385), (1.50, 0.0037)),
        "ts-ff": ((59.99, 0.1714), (1.50, 0.0032)),
        "ts-gbm": ((60.01, 0.69), (1.50, 0.0143)),
    }
    for name, (phase_margin, crossover) in expected.items():
        paper = row(evaluation(name), Task())["paper"]
        assert paper == {"phase_margin": phase_margin, "crossover": crossover} == PAPER[name]
    assert row(evaluation("ts-ff-gains"), Task())["paper"] is None


def test_the_bound_is_a_row_of_root_mean_squares():
    found = bound_row(np.array([[0.3, 0.01], [0.4, 0.07]]), Task())
    assert found["episodes"] == 2
    assert found["phase_margin"] == {"mean": 60.0, "std": pytest.approx(0.125**0.5)}
    assert found["crossover"] == {"mean": 1.5, "std": pytest.approx(0.05)}


def rows():
    spread = np.array([[0.01, 0.0004]])
    return [row(evaluation(n), Task()) for n in ("ts-ff", "nominal")] + [bound_row(spread, Task())]


def test_json_loads_again():
    text = to_json(rows(), {"episodes": 5, "seed": 0})
    loaded = json.loads(text)
    assert loaded["conditions"] == {"episodes": 5, "seed": 0}
    assert [r["tuner"] for r in loaded["rows"]] == ["ts-ff", "nominal", "Cramér–Rao bound"]
    first = loaded["rows"][0]
    assert first["paper"]["phase_margin"] == [59.99, 0.1714]
    assert first["phase_margin"]["std"] == rows()[0]["phase_margin"]["std"]
    assert "NaN" not in text and text.endswith("}\n")


def test_markdown_is_a_table():
    lines = to_markdown(rows()).splitlines()
    cells = [[c.strip() for c in line.strip("|").split("|")] for line in lines]
    assert len(lines) == 2 + 3 and {len(c) for c in cells} == {11}
    assert set(cells[1]) == {"---"}
    header, first, second, bound = cells[0], *cells[2:]
    assert (first[0], second[0], bound[0]) == ("`ts-ff`", "`nominal`", "*Cramér–Rao bound*")
    column = dict(zip(header, first, strict=False))
    assert column["phase margin [°] mean ± std"] == "60.000 ± 0.791"
    assert column["crossover [Hz] mean ± std"] == "1.4975 ± 0.0148"
    assert (column["rms% kp"], column["rms% Ti"], column["unstable"]) == ("10.0", "20.0", "2")
    assert first[3] == "59.99 ± 0.1714" and first[6] == "1.5 ± 0.0032" and second[3] == ""
    assert bound[1] == "60.000 ± 0.0100" and bound[7:] == ["", "", "", "1 / 1"]


@pytest.mark.parametrize(
    "spread, text",
    [(0.2386, "0.239"), (12.34, "12.3"), (123.4, "123"), (0.00037, "0.000370"), (3e-14, "3e-14"),
     (0.0, "0"), (np.nan, "nan")],
)  # fmt: skip
def test_spreads_are_shown_to_three_digits(spread, text):
    shown = bound_row(np.full((1, 2), spread), Task())
    assert f"60.000 ± {text} |" in to_markdown([shown])
