"""Statistics on known examples, and Table III made of them (`test_pages` has the table itself)."""

import json

import numpy as np
import pytest

from studies.metrics import bootstrap_interval, ratio_of_rms, rms, rms_percent
from studies.table3 import PAPER, bound_row, row, to_json, to_markdown
from tuners.tuner.evaluation import Evaluation
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate


def test_rms_percent_is_relative_to_the_truth():
    # Errors of -10 % and +20 %: root of (100 + 400)/2.
    assert rms_percent(np.array([1.0, -5.0]), np.array([1.1, -4.0])) == pytest.approx(250**0.5)


@pytest.mark.parametrize("level, quantile", [(0.95, 1.960), (0.68, 0.994)])
def test_interval_of_mean_and_std_of_normal_values(level, quantile):
    n = 1500
    values = np.random.default_rng(0).normal(60.0, 0.1, n)
    for statistic, error in ((np.mean, 0.1 / n**0.5), (np.std, 0.1 / (2 * n) ** 0.5)):
        low, high = bootstrap_interval(values, statistic, level=level)
        assert low < statistic(values) < high
        # 2000 resamples give a quantile to 5 %, 1500 values the spread to 2 %, twice each.
        assert high - low == pytest.approx(2 * quantile * error, rel=0.12)


def test_interval_depends_on_its_seed_alone():
    values = np.random.default_rng(2).standard_normal(40)
    assert bootstrap_interval(values, np.std) == bootstrap_interval(values, np.std)
    assert bootstrap_interval(values, np.std) != bootstrap_interval(values, np.std, seed=1)
    for equal in (np.full(10, 3.0), np.array([3.0])):
        assert bootstrap_interval(equal, np.mean) == (3.0, 3.0)


def test_ratio_of_rms_is_that_of_the_two_columns():
    pairs = np.random.default_rng(0).standard_normal((4, 50, 2))
    expected = rms(pairs[2, :, 0]) / rms(pairs[2, :, 1])
    assert ratio_of_rms(pairs, axis=1)[2] == pytest.approx(expected, rel=1e-12)
    low, high = bootstrap_interval(pairs[2], ratio_of_rms)
    assert low < expected < high
    pairs[2, :, 0] = 3 * pairs[2, :, 1]  # columns of a row stay together
    assert bootstrap_interval(pairs[2], ratio_of_rms) == pytest.approx((3.0, 3.0))


PLANT = yaw_rate(Task())
PHASES = np.array([59.0, 61.0, 60.5, np.nan, 59.5])
CROSSOVERS = np.array([1.49, 1.52, 1.5, np.nan, 1.48])
THETA = np.array([[0.4, 0, 20.0], [0.6, 100, 20], [0.8, 200, 20], [1.0, 300, 20], [0.5, 50, 20]])


def evaluation(tuner="ts-ff", phases=PHASES):
    gains = PLANT.oracle(THETA) * [1.1, 0.8]
    stable = np.array([True, True, True, False, False])
    seconds = np.array([1e-3, 2e-3, 9.0, 1e-3, 4e-3])
    metrics = np.stack([phases, CROSSOVERS], axis=1)
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
    found = bound_row(np.array([[0.3, 0.01], [0.4, 0.07]]), PLANT.target)  # root mean squares
    assert found["episodes"] == 2
    assert found["phase_margin"] == {"mean": 60.0, "std": pytest.approx(0.125**0.5)}
    assert found["crossover"] == {"mean": 1.5, "std": pytest.approx(0.05)}


def test_the_papers_values_stand_beside_its_own_tuners():
    # Table III as printed.
    assert PAPER == {
        "gb": {"phase_margin": (59.98, 0.2385), "crossover": (1.50, 0.0037)},
        "ts-ff": {"phase_margin": (59.99, 0.1714), "crossover": (1.50, 0.0032)},
        "ts-gbm": {"phase_margin": (60.01, 0.69), "crossover": (1.50, 0.0143)},
    }
    assert row(evaluation("gb"))["paper"] == PAPER["gb"]
    assert row(evaluation("ts-ff-1khz"))["paper"] == PAPER["ts-ff"]
    assert row(evaluation("ts-ff"))["paper"] is None  # not the recipe as printed
    assert row(evaluation("ts-ff-gains"))["paper"] is None


def test_json_and_markdown_hold_the_rows():
    rows = [row(evaluation()), bound_row(np.array([[0.01, 0.0004]]), PLANT.target)]
    text = to_json(rows, {"episodes": 5, "seed": 0})
    loaded = json.loads(text)
    assert loaded["conditions"] == {"episodes": 5, "seed": 0}
    std = rows[0]["phase_margin"]["std"]
    assert loaded["rows"][0]["phase_margin"]["std"] == float(f"{std:.6g}")
    other = json.loads(to_json([row(evaluation(phases=PHASES + 1e-11))], {}))["rows"]
    assert other == loaded["rows"][:1]  # another processor's rounding is not stored
    assert "NaN" not in text and text.endswith("}\n")
    first, bound = (line.split(" | ") for line in to_markdown(rows).splitlines()[2:])
    assert first[1] == "60.000 ± 0.791" and first[7:10] == ["10.0", "20.0", "2"]
    assert bound[0] == "| *Cramér–Rao bound*" and bound[-1] == "1 / 1 |"
