"""Conditions off the design point: what they do to recordings and truth, and the tables."""

import json
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_hex
from recordings import recorded
from scipy.signal import welch

import tuners
from studies import conditions, draws, off_design_page, palette, pictures, plots
from studies.bounds import bound_on
from studies.conditions import SPEED, SWEEPS
from studies.metrics import rms
from studies.off_design import Accuracy, cell, measure
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

TASK = Task()
PLANT = yaw_rate(TASK)
TARGET = PLANT.target
FEW = 12
TUNERS = {name: tuners.load(name) for name in ("gb", "ts-ff-lag")}


def named(condition):
    return condition.split(" [")[0].removesuffix(" off by")


SHORT = {named(sweep.name): sweep for sweep in SWEEPS}


def made(sweep, level, count=4, task=TASK):
    """What a condition shows of the first test episodes, and the task that is true."""
    truth, transformed = sweep.make(task, level)
    plant = yaw_rate(truth)
    drawn = draws.draw(plant, "test", 0, 0, count)
    return truth, transformed(draws.recorded(plant, drawn), drawn)


def keys(count):
    return draws.draw(PLANT, "test", 0, 0, count).keys


@pytest.fixture(scope="module")
def plain():
    return measure(TUNERS, TASK, SHORT["excitation register"], "same", FEW, 0)


@pytest.mark.parametrize("sweep", SWEEPS, ids=lambda s: s.name)
def test_the_design_level_changes_nothing(sweep):
    truth, shown = made(sweep, sweep.design)
    usual = recorded(4)
    assert (truth.vehicle, truth.prior, truth.target) == (TASK.vehicle, TASK.prior, TASK.target)
    np.testing.assert_allclose(shown.y, usual.y, atol=1e-9)  # 200 dB under coloured noise
    np.testing.assert_array_equal(shown.u, usual.u)
    np.testing.assert_array_equal(shown.known[:, 2], usual.known[:, 2])
    assert sweep.design in sweep.levels


def test_coloured_noise_has_the_stated_power_and_spectrum():
    corner, Ts, N = 2.0, 0.001, 200_000
    noise = conditions.coloured(keys(8), N, Ts, corner)
    # A first-order process keeps 2 pi corner N Ts / 2 independent samples of its variance.
    tolerance = 4 * np.sqrt(2 / (np.pi * corner * N * Ts * 8))
    assert noise.var() == pytest.approx(1, abs=tolerance)
    f, power = welch(noise, fs=1 / Ts, nperseg=8192)
    model = 2 / (np.pi * corner) / (1 + (f / corner) ** 2)  # one-sided, of unit power
    band = (f > 0.5) & (f < 50)
    assert abs(np.log(power.mean(axis=0)[band] / model[band])).mean() < 0.1
    first = conditions.coloured(keys(2000), 2, Ts, corner)[:, 0]
    assert first.var() == pytest.approx(1, abs=4 * np.sqrt(2 / 2000))  # stationary from the start


@pytest.mark.parametrize(
    ("name", "level", "power", "count", "rtol"),
    [
        ("signal-to-noise ratio", 10.0, 1e-1, 4, 4 * np.sqrt(2 / 40_000)),
        ("signal-to-noise ratio", 50.0, 1e-5, 4, 4 * np.sqrt(2 / 40_000)),
        ("corner of coloured noise", 2.0, 1e-3, 100, 0.1),
    ],
)
def test_noise_is_as_strong_as_stated(name, level, power, count, rtol):
    _, shown = made(SHORT[name], level, count)
    _, clean = made(SHORT["signal-to-noise ratio"], 200.0, count)
    share = ((shown.y - clean.y) ** 2).mean(axis=1) / (clean.y**2).mean(axis=1)
    assert share.mean() == pytest.approx(power, rel=rtol)


def test_a_shorter_episode_is_the_beginning_of_the_longer():
    shorter, longer = (made(SHORT["episode length"], seconds)[1] for seconds in (5.0, 20.0))
    assert shorter.y.shape == (4, 5000) and longer.y.shape == (4, 20_000)
    np.testing.assert_array_equal(shorter.u, longer.u[:, :5000])
    assert np.corrcoef(shorter.y[0], longer.y[0, :5000])[0, 1] > 0.999


@pytest.mark.parametrize(("name", "channel"), [("yaw rate", "y"), ("steering", "u")])
def test_bias_is_a_constant_in_units_of_the_root_mean_square(name, channel):
    _, shown = made(SHORT[f"bias of {name}"], 0.3)
    usual = recorded(4)
    added = getattr(shown, channel) - getattr(usual, channel)
    size = np.sqrt((getattr(usual, channel) ** 2).mean(axis=1, keepdims=True))
    np.testing.assert_allclose(added, np.broadcast_to(0.3 * size, added.shape), rtol=1e-9)
    other = "u" if channel == "y" else "y"
    np.testing.assert_array_equal(getattr(shown, other), getattr(usual, other))


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("yaw inertia", {"J_z": 0.8 * 2400}),
        ("actuator bandwidth", {"omega_n": 0.8 * 2 * np.pi * 5}),
        ("relaxation lengths", {"l_rel_f": 0.8 * 0.4, "l_rel_r": 0.8 * 0.8}),
    ],
)
def test_the_true_vehicle_differs_as_stated_and_in_nothing_else(name, parameters):
    truth, shown = made(SHORT[name], -20.0)
    for parameter, value in parameters.items():
        assert getattr(truth.vehicle, parameter) == pytest.approx(value)
    own = {parameter: getattr(TASK.vehicle, parameter) for parameter in parameters}
    assert replace(truth, vehicle=replace(truth.vehicle, **own)) == TASK
    assert np.abs(shown.y - recorded(4).y).max() > 10 * 1e-3 * recorded(4).y.std()


def test_a_wrong_speed_is_claimed_and_another_one_true():
    truth, shown = made(SPEED, -2.0)
    np.testing.assert_array_equal(shown.known[:, 2], 20.0)
    plant = yaw_rate(truth)
    drawn = draws.draw(plant, "test", 0, 0, 4)
    np.testing.assert_array_equal(drawn.theta[:, 2], 18.0)
    np.testing.assert_array_equal(shown.y, draws.recorded(plant, drawn).y)


def test_gray_box_sits_on_the_bound_and_a_wrong_twin_does_not(plain):
    gb = plain[0]
    bound = rms(bound_on(PLANT, "test", 0, FEW))
    assert [gb.phase_margin.bound, gb.crossover.bound] == pytest.approx(list(bound))
    assert gb.phase_margin.ratio == pytest.approx(1, abs=4 / np.sqrt(2 * FEW))
    assert gb.trusted == FEW and gb.misses == 0
    (wrong,) = measure({"gb": TUNERS["gb"]}, TASK, SHORT["actuator bandwidth"], -20.0, FEW, 0)
    assert wrong.phase_margin.rms > 100 * gb.phase_margin.rms and wrong.phase_margin.bound is None
    assert wrong.trusted_misses == 0 < wrong.misses
    # A refusal is a cell with the tuner's message.
    short = SHORT["episode length"]
    (found,) = measure({"ts-ff": tuners.load("ts-ff")}, TASK, short, 1.0, 3, 0)
    assert "samples" in found.refused and found.phase_margin.rms is None
    assert (found.trusted, found.unstable, found.misses) == (0, 0, 0)


def test_a_cell_counts_what_missed_and_what_was_trusted():
    rows = [
        (60.0, 1.5, 1, 1), (62.9, 1.5, 1, 1), (63.1, 1.5, 1, 0), (60.0, 1.66, 1, 1),
        (np.nan, np.nan, 0, 1), (np.nan, np.nan, 1, 0),
    ]  # fmt: skip
    answers = np.array(rows)
    found = cell(("a", 1.0, "b", 6), answers, TARGET, np.array([2.0, 0.1]))
    assert (found.unstable, found.misses, found.trusted, found.trusted_misses) == (1, 4, 4, 2)
    assert found.phase_margin.rms == pytest.approx(np.sqrt((2.9**2 + 3.1**2) / 4))
    assert found.phase_margin.ratio == pytest.approx(found.phase_margin.rms / 2)
    low, high = found.phase_margin.interval
    assert low <= found.phase_margin.rms <= high
    assert Accuracy.of(np.array([np.nan])) == Accuracy(None, None, None, None)


@pytest.fixture
def cells():
    """Every condition; errors that tell where they come from; one refusal."""
    refusal = SWEEPS[1].name, 1.0, "ts-ff", 2
    made = []
    for s, sweep in enumerate(SWEEPS):
        for i, level in enumerate(sweep.levels):
            known = sweep.bounded or level == sweep.design
            bound = np.array([0.5, 0.1]) if known else None
            answers = np.array([[61 + s + i / 10, 1.5, 1, i % 2]] * 2)
            for name in ("gb", "ts-ff"):
                which = sweep.name, level, name, 2
                if which == refusal:
                    made.append(cell(which, answers[:0], TARGET, None, "Too short."))
                else:
                    made.append(cell(which, answers, TARGET, bound))
    return made


def test_page_has_every_condition_and_the_design_point_once(cells, tmp_path):
    off_design_page.write(cells, 3, tmp_path)
    text = (tmp_path / "off_design.md").read_text()
    first = text.split("## ")[1].splitlines()
    rows = [line for line in first if line.startswith("| ") and "---" not in line]
    assert len(rows) == 2 + sum(len(sweep.levels) - 1 for sweep in SWEEPS)
    assert rows[0] == "| condition | bound | `gb` | `ts-ff` |"
    assert rows[1].startswith("| design point | 0.5 | ")
    assert "| episode length [s]: 1 | 0.5 | 2 (4) | refused |" in rows
    assert "- `ts-ff`, episode length [s]: 1: Too short." in text and "seed 3" in text
    read = json.loads((tmp_path / "off_design.json").read_text(), parse_constant=pytest.fail)
    assert len(read["cells"]) == len(cells) and read["conditions"]["seed"] == 3


def test_picture_has_a_panel_a_condition(cells, tmp_path, monkeypatch):
    monkeypatch.setattr(plots, "DPI", 20)
    figure = pictures.off_design(cells)
    panels = [axes for axes in figure.axes if axes.axison]
    assert [axes.get_xlabel() for axes in panels] == [sweep.name for sweep in SWEEPS]
    for axes, sweep in zip(panels, SWEEPS, strict=True):
        assert axes.get_yscale() == "log"
        assert len(axes.get_xticks()) == len(sweep.levels)
        assert len(axes.collections) == (len(sweep.levels) if sweep.bounded else 1)
        dots = [line for line in axes.get_lines() if line.get_marker() == "o"]
        hollow = [line.get_markerfacecolor() == "white" for line in dots]
        here = (c for c in cells if c.condition == sweep.name and not c.refused)
        assert sum(hollow) == sum(c.trusted == 0 for c in here)
    (cross,) = (line for axes in panels for line in axes.get_lines() if line.get_marker() == "x")
    assert to_hex(cross.get_color()) == palette.colour("ts-ff").lower()
    plots.save(figure, tmp_path / "off.png")
