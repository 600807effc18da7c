"""Measurements of speed and size: rivals that answer the same, ratios of times, pages."""

import json

import numpy as np
import pytest
from imports import modules_after
from matplotlib.figure import Figure
from recordings import recorded, vehicles

from benchmarks import page, rivals, stages
from benchmarks.stopwatch import Contender, race
from benchmarks.throughput import measure
from studies import dataset_scale
from studies.dataset_scale import Size
from tuners.features.laguerre import Laguerre
from tuners.trust.identification import identify
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

PLANT = yaw_rate(Task())


def test_contenders_take_turns_and_the_first_is_compared_with_all():
    calls = []

    def work(name, episodes):
        return lambda: calls.append(name) or episodes

    contenders = {"a": Contender(work("a", 1000)), "b": Contender(work("b", 1), rounds=1)}
    found = race(contenders, 3, lambda done, of: None)
    assert "".join(calls) == "abab" + "aa"  # a round to warm up, then one of three with b
    assert [f["rounds"] for f in found.values()] == [3, 1]
    assert found["a"]["ratio"] == {"median": 1.0, "least": 1.0, "most": 1.0}
    assert found["b"]["ratio"]["median"] > 10  # for a thousandth of the episodes


def test_rivals_simulate_the_same_vehicle():
    recording = recorded(1)
    ours = PLANT.respond(recording.known, recording.u)[0]
    works = rivals.simulations(Task(), vehicles(recording), recording.u[0])
    assert len(works) == 3
    for work in works.values():
        np.testing.assert_allclose(work(), ours, rtol=0, atol=1e-9 * np.abs(ours).max())


@pytest.mark.slow  # python-control simulates twenty times
def test_rivals_fit_and_identify_the_same():
    recording = recorded(1)
    ours, _ = Laguerre(8)(recording.u, recording.y, recording.Ts)
    np.testing.assert_allclose(rivals.laguerre(Laguerre(8), recording)(), ours[0], rtol=1e-9)
    ours = identify(PLANT, recording.u, recording.y).theta[0, :2]
    # A search ends where a step promises a 1e-10 of the cost: 1e-5 of a standard deviation.
    np.testing.assert_allclose(rivals.gray_box(Task(), recording)(), ours, rtol=1e-5)


def test_simulation_leaves_python_control_behind():
    found = race(stages.simulations(64), 2, lambda done, of: None)
    # Thousands where nothing else runs.
    assert found["python-control forced_response"]["ratio"]["least"] > 100
    assert found["scipy sosfilt"]["ratio"]["median"] > 0.3  # above 1 where nothing else runs


def test_an_input_in_every_episode_costs_less_than_one_after_the_other():
    found = race(stages.laguerre_fits(32), 2, lambda done, of: None)
    assert found["scipy lfilter and numpy lstsq"]["ratio"]["median"] > 1


def test_a_machines_tables_are_replaced_and_others_stay(tmp_path):
    file = tmp_path / "benchmark.json"
    assert page.stored(file) == {}
    file.write_text(json.dumps({"another": result(), "a processor": {"old": 1}}))
    assert page.stored(file) | {"a processor": result()} == {
        "another": result(), "a processor": result()
    }  # fmt: skip


@pytest.mark.slow  # starts processes
def test_commands_are_timed_beside_numpy():
    found = stages.commands(2)
    first, *others = (times["ratio"]["median"] for times in found.values())
    assert first == 1 and others[0] < others[1] < others[2]
    assert others[0] < 3 and others[1] < 18 and others[2] < 36


@pytest.mark.slow  # compiles
def test_growth_is_measured_in_a_fresh_process():
    found = stages.growth_in_fresh_process([10])
    assert [row["size"] for row in found["episodes"]] == [10]
    assert all(row["first"] > 0 for row in found["samples"])


def result():
    times = {"milliseconds": {"median": 2.0, "least": 1.0, "most": 3.0}}
    times["ratio"] = {"median": 1.0, "least": 1.0, "most": 1.0}
    row = {"size": 100, "count": 100, "seconds": 0.5, "megabytes": 200.0}
    long = row | {"first": 0.75}
    return {
        "commit": "abc1234", "versions": {"numpy": "2"}, "batch": 64, "rounds": 2,
        "page_faults": {"64": 3.0}, "commands": {"yawrate tune": times}, "first_answer": 5.04,
        "stages": {
            "Environment": {"batch environment": times},
            **{how: dict.fromkeys(stages.TUNERS, times) for how in stages.ANSWERS},
        },
        "first": {"import": {"cold": 1.0, "cached": 0.5}},
        "growth": {"episodes": [row, row | {"size": 1000, "seconds": 5.0}], "samples": [long]},
        "training": {"ts-ff": 3.0},
    }  # fmt: skip


def test_the_page_and_picture_have_all_that_was_measured():
    text = page.to_markdown({"a processor": result(), "another": result()})
    assert text.count("## a processor") == text.count("## another") == 1
    assert text.count("Commit abc1234;") == 2
    assert all(text.count(f"### {how}") == 2 for how in stages.ANSWERS)
    assert text.count("| ts-ff-lag | 2 (1 to 3) | 1 (1 to 1) |") == 6
    assert "| 64 environments | 3 |" in text and "compiled yet: 5.0 s" in text
    assert "| `yawrate tune` | 0.002 (0.001 to 0.003) | 1 (1 to 1) |" in text
    assert "| 1000 episodes | 100 | 5.00 | 50 | 200 |" in text
    assert "| import | 1.00 | 0.50 |" in text and "| ts-ff | 3.0 |" in text
    assert text.count("never had: 0.75 s.") == 2
    assert "Not installed" in text and "pysib" in text
    picture = page.picture("a processor", result())
    assert isinstance(picture, Figure)
    labels = [text.get_text() for text in picture.axes[0].get_yticklabels()]
    assert labels == list(stages.TUNERS)


def test_a_batch_beats_scalar_environments_one_after_the_other():
    found = measure(num_envs=32, rounds=3)
    first, *_ = found
    assert first == "batch environment, 32" and found[first]["ratio"]["median"] == 1
    # About 4 where nothing else runs: a ratio below 1 would mean that batching costs time.
    assert found["SyncVectorEnv"]["ratio"]["median"] > 1
    assert found["plain loop over reset and step"]["ratio"]["median"] > 1
    assert all(f["milliseconds"]["least"] > 0 for f in found.values())


# --- data sets


SIZES = [Size(n, 2.0 + 1e-4 * n, 500.0, 120.0, 0.0) for n in (1000, 10_000, 100_000)]


def test_a_line_through_sizes_of_equal_weight():
    start, each, error = dataset_scale.fit(SIZES)
    assert start == pytest.approx(2.0) and each == pytest.approx(1e-4) and error < 1e-12
    start, each, error = dataset_scale.fit([*SIZES, Size(1_000_000, 112.2, 500.0, 120.0, 0.0)])
    assert abs(start + 1e3 * each - 2.1) < 0.05 * 2.1 and 0.03 < error < 0.1


def test_report_table_and_picture():
    result = dataset_scale.report([*SIZES, Size(1_000_000, 110.0, 600.0, 120.0, 1e-12)])
    assert json.loads(json.dumps(result)) == result
    text = dataset_scale.to_markdown(result)
    assert "| 100 000 | 12.0 | 8333 | 500 | 120 | equal |" in text
    assert "off by 1.0e-12" in text and "µs × episodes" in text
    left, right = dataset_scale.picture(result).axes
    assert left.get_xlabel() == right.get_xlabel() == "episodes"
    assert right.get_ylim()[1] > dataset_scale.MEMORY_LIMIT


@pytest.mark.slow
def test_a_size_is_measured(tmp_path):
    found = dataset_scale.measure(200, tmp_path)
    assert found.episodes == 200 and found.deviation == 0
    assert found.seconds > 0 and found.peak > 50 and 50 < found.stored < 1000
    assert list(tmp_path.iterdir()) == []


def test_importing_data_sets_is_light():
    loaded = modules_after("import tuners.data")
    assert "pyarrow" in loaded
    heavy = {"torch", "xgboost", "distributed", "dask", "joblib", "minari", "pandas", "h5py"}
    assert not loaded & (heavy | {"matplotlib", "tqdm"})
