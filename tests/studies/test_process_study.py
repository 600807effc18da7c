"""Recordings by SciPy of process plants, and what the study counts on them."""

import json

import control
import numpy as np
import pytest

import tuners
from studies import corners, process_plants
from studies.process_recordings import (
    FAULTS,
    Fault,
    clipped,
    curved,
    loose,
    output,
    recordings,
    returning,
    rubbing,
    skipping,
)
from tuners.tuner.hidden_faults import Hidden
from yawrate_env import plants
from yawrate_env.signals.excitation import prbs

STEP = 0.05
COMMAND = np.repeat(prbs(60, 1.0, 5.0, 1.0, start=np.array([3], np.uint64))[0], 20)
MODELS = {
    "fopdt": ({"K": 1.3, "T": 14.0, "L": 5.35}, [14.0, 1.0]),
    "sopdt": ({"K": 0.7, "T1": 14.0, "T2": 3.0, "L": 2.0}, np.polymul([14.0, 1.0], [3.0, 1.0])),
    "integrator": ({"K": 0.05, "L": 3.2}, [1.0, 0.0]),
}


@pytest.mark.parametrize("name", MODELS)
def test_outputs_are_those_of_python_control(name):
    parameters, denominator = MODELS[name]
    found = output(parameters, COMMAND, STEP, 0.0)[:-1]
    late = round(parameters["L"] / STEP)
    u = np.r_[np.zeros(late), COMMAND][: len(COMMAND)]
    model = control.ss(control.tf([parameters["K"]], denominator)).sample(STEP)
    right = control.forced_response(model, np.arange(len(u)) * STEP, u).outputs
    np.testing.assert_allclose(found, right, atol=2e-4 * np.abs(right).max())


def test_valves_follow_two_levels_and_change_what_lies_between():
    rng, two = np.random.default_rng(0), np.array([1.0, 1.0, -1.0, 1.0, -1.0])
    np.testing.assert_allclose(clipped(two, STEP, rng), 0.7 * two)
    for valve in (curved, rubbing):
        np.testing.assert_allclose(valve(two, STEP, rng), two, atol=1e-12)
    several = np.array([1.0, 0.8, 0.6, -1.0])
    np.testing.assert_allclose(rubbing(several, STEP, rng), [1.0, 1.0, 0.6, -1.0])
    assert (curved(several, STEP, rng)[1:3] < several[1:3]).all()
    turning = np.array([0.0, 1.0, 0.9, 0.4, 0.0, 0.2, 0.5])
    np.testing.assert_allclose(loose(turning, STEP, rng), [0, 0.85, 0.85, 0.55, 0.15, 0.15, 0.35])
    # Of 1 at most: behind by (S - J)/2 = 0.15 in motion, and stuck until S = 0.4 after a turn.
    np.testing.assert_allclose(
        returning(turning, STEP, rng), [0, 0.85, 0.85, 0.55, 0.15, 0.15, 0.35]
    )
    # Slips where more than (S + J)/2 = 0.25 has built up, and keeps 0.15 of it.
    np.testing.assert_allclose(
        skipping(turning, STEP, rng), [0, 0.85, 0.85, 0.55, 0.15, 0.15, 0.35]
    )


def test_faults_act_on_time_scale_and_output():
    plant, theta = plants.fopdt(experiment={"noise": 0.0}), np.array([[1.0, 20.0, 8.0]])

    def recorded(**fault):
        return recordings(plant, theta, Fault("", **fault), 0)

    u, y, Ts = recorded()
    assert u.shape == y.shape == (1, 600) and Ts == 1.0
    np.testing.assert_allclose(plant.simulate(theta, u[0], None), y, atol=1e-9)
    np.testing.assert_allclose(recorded(late=5)[1][:, 5:], y[:, :-5])
    np.testing.assert_allclose(recorded(scale=1.5)[1], 1.5 * y)
    assert recorded(stretch=2.0)[2] == 2.0


def test_right_recordings_sit_on_the_bound_and_a_scaled_output_misses(tmp_path, monkeypatch):
    monkeypatch.setattr(process_plants, "train", lambda plant, **_: tuners.load("gb", plant))
    hidden = Hidden("a late output", 0.8, {})
    monkeypatch.setattr(process_plants, "hidden_faults", lambda *_: [hidden])
    plant = plants.fopdt()
    page = tmp_path / "page.md"
    page.write_text("<!-- process_plants:start -->\n<!-- process_plants:end -->\n")
    text = process_plants.run(plant, "fopdt", tmp_path, count=60, faulty=12, seed=0, readme=page)
    part = json.loads((tmp_path / "process_plants.json").read_text())["fopdt"]
    assert all(0.7 < ratio < 1.3 for ratio in part["right"]["over_bound"].values())
    assert part["right"]["usable"] > 0.9 and part["right"]["missed"] == 0
    faults = {row["fault"]: row for row in part["faults"]}
    assert list(faults) == [fault.name for fault in FAULTS[1:]]
    assert faults["output x 1.5"]["missed"] == 1.0 and faults["offset"]["missed"] == 0.0
    assert faults["Ts x 2"]["refused_by"]["stretched"] == 12
    assert "12 with each fault" in text and "a late output (80.0 %)" in text
    assert text in (tmp_path / "process_plants.md").read_text()
    scaled = faults["output x 1.5"]
    shares = (
        f"{100 * scaled['usable_and_missed']:.1f} % ({100 * scaled['with_care_and_missed']:.1f} %)"
    )
    assert f"| output x 1.5 | {shares} |" in page.read_text()


WIDE = {"K": {"log": [0.1, 10.0]}, "T": {"log": [5.0, 50.0]}, "L": 4.0}


def test_corners_are_the_outermost_tenths_in_the_priors_own_distribution():
    plant = plants.fopdt(**WIDE)
    shares = dict(corners.parts(plant))
    assert list(shares) == [
        "K low, T low", "K low, T high", "K high, T low", "K high, T high", "middle",
    ]  # fmt: skip
    theta = corners.drawn(plant, shares["K low, T high"], 200, 0)
    tenth = np.log10(theta[:, 0]) + 1  # of two decades
    assert 0 <= tenth.min() < 0.02 and 0.18 < tenth.max() <= 0.2
    assert theta[:, 1].min() >= 5.0 * 10**0.9 and theta[:, 1].max() <= 50.0
    assert (theta[:, 2] == 4.0).all()
    middle = np.log10(corners.drawn(plant, shares["middle"], 200, 0)[:, 0])
    assert -0.5 <= middle.min() and middle.max() <= 0.5


def test_the_gray_box_is_on_the_bound_in_every_corner(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("<!-- corners:start -->\n<!-- corners:end -->\n")
    tuner = tuners.load("gb", plants.fopdt(**WIDE, experiment={"noise": 0.01}))
    text = corners.write(tuner, "wide", tmp_path, 60, 0, page)
    rows = json.loads((tmp_path / "corners.json").read_text())["wide"]["parts"]
    # The standard error of a ratio of 60 recordings is 9 %.
    assert max(max(row["over_bound"].values()) for row in rows) < 1.4
    assert text in page.read_text() and text in (tmp_path / "corners.md").read_text()
