"""Table III: its rows and its JSON; `test_pages` has the table itself."""

import json

import numpy as np
import pytest

from studies.metrics import bootstrap_interval
from studies.table3 import PAPER, bound_row, row, to_json, to_markdown
from tuners.tuner.evaluation import Evaluation
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

PLANT = yaw_rate(Task())
PHASES = np.array([59.0, 61.0, 60.5, np.nan, 59.5])
CROSSOVERS = np.array([1.49, 1.52, 1.5, np.nan, 1.48])
THETA = np.stack(
    [[0.4, 0.6, 0.8, 1.0, 0.5], [0.0, 100.0, 200.0, 300.0, 50.0], np.full(5, 20.0)], axis=1
)


def evaluation(tuner="ts-ff"):
    gains = PLANT.oracle(THETA) * [1.1, 0.8]
    stable = np.array([True, True, True, False, False])
    seconds = np.array([1e-3, 2e-3, 9.0, 1e-3, 4e-3])
    metrics = np.stack([PHASES, CROSSOVERS], axis=1)
    return Evaluation(tuner, PLANT, THETA, gains, metrics, stable, seconds)


def test_a_rows_numbers():
    found = row(evaluation())
    assert (found["tuner"], found["episodes"], found["unstable"]) == ("ts-ff", 5, 2)
    for name, values, target in (("phase_margin", PHASES, 60.0), ("crossover", CROSSOVERS, 1.5)):
        values = values[np.isfinite(values)]
        assert found[name] == {
            "mean": pytest.approx(values.mean()),
            "std": pytest.approx(values.std()),
            "rmse": pytest.approx(np.sqrt(np.mean((values - target) ** 2))),
            "mean_interval": bootstrap_interval(values, np.mean),
            "std_interval": bootstrap_interval(values, np.std),
        }
    assert found["rms_percent"] == pytest.approx({"kp": 10.0, "Ti": 20.0})
    assert found["median_seconds"] == 2e-3


def test_the_papers_values_stand_beside_its_own_tuners():
    # Table III as printed.
    assert PAPER == {
        "gb": {"phase_margin": (59.98, 0.2385), "crossover": (1.50, 0.0037)},
        "ts-ff": {"phase_margin": (59.99, 0.1714), "crossover": (1.50, 0.0032)},
        "ts-gbm": {"phase_margin": (60.01, 0.69), "crossover": (1.50, 0.0143)},
    }
    assert row(evaluation("gb"))["paper"] == PAPER["gb"]
    assert row(evaluation("ts-ff-gains"))["paper"] is None


def test_the_bound_is_a_row_of_root_mean_squares():
    found = bound_row(np.array([[0.3, 0.01], [0.4, 0.07]]), PLANT.target)
    assert found["episodes"] == 2
    assert found["phase_margin"] == {"mean": 60.0, "std": pytest.approx(0.125**0.5)}
    assert found["crossover"] == {"mean": 1.5, "std": pytest.approx(0.05)}


def test_json_and_markdown_hold_the_rows():
    rows = [row(evaluation()), bound_row(np.array([[0.01, 0.0004]]), PLANT.target)]
    text = to_json(rows, {"episodes": 5, "seed": 0})
    loaded = json.loads(text)
    assert loaded["conditions"] == {"episodes": 5, "seed": 0}
    assert loaded["rows"][0]["phase_margin"]["std"] == rows[0]["phase_margin"]["std"]
    assert "NaN" not in text and text.endswith("}\n")
    first, bound = (line.split(" | ") for line in to_markdown(rows).splitlines()[2:])
    assert first[1] == "60.000 ± 0.791" and first[7:10] == ["10.0", "20.0", "2"]
    assert bound[0] == "| *Cramér–Rao bound*" and bound[-1] == "1 / 1 |"
