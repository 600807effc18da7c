"""Gains over a measured parameter, from recordings of one plant."""

from dataclasses import replace

import numpy as np
import pytest
from command import FEW
from first_order import SIGMA, TS, U, gauged, plant
from vehicle_logs import VEHICLE, black, drive, learned

import tuners
from tuners.tuner.recording import Recording
from yawrate_env.vehicle.task import Task

SPEEDS = 12.0, 20.0, 30.0


@pytest.fixture(scope="module")
def drives():
    return [drive(0.7, v, 20 + k) for k, v in enumerate(SPEEDS)]


def test_gains_are_the_design_rules_and_their_intervals_hold_them(drives):
    found = tuners.schedule(learned(), drives, [12.0, 16.0, 24.0, 30.0])
    theta = np.array([[0.7, 120.0, v] for v in found.values])
    truth = VEHICLE.oracle(theta)
    np.testing.assert_allclose(found.gains, truth, rtol=3e-3)
    assert found.trusted and not found.alone
    for right, result in zip(truth, found.results, strict=True):
        for value, name in zip(right, ("kp", "Ti"), strict=True):
            wide, narrow = result.gain_intervals[name], result.exact_gain_intervals[name]
            assert narrow.high - narrow.low < wide.high - wide.low < 0.02 * value
            assert abs(value - narrow.value) < 2 * (narrow.high - narrow.low)


def test_what_a_straight_line_costs(drives):
    coarse, fine = (tuners.schedule(learned(), drives, np.linspace(12, 30, n)) for n in (3, 9))
    name = "phase_margin [deg]"
    # The error of linear interpolation falls with the square of the step.
    assert coarse.interpolation[name] / fine.interpolation[name] == pytest.approx(16, rel=0.6)


def test_by_default_it_covers_the_recordings(drives):
    found = tuners.schedule(learned(), drives)
    assert (found.values[0], found.values[-1], len(found.values)) == (12.0, 30.0, 9)


def test_beyond_the_recordings_it_says_so(drives):
    found = tuners.schedule(learned(), drives[:2], [12.0, 20.0, 30.0])
    assert [r.verdict for r in found.results] == ["usable", "usable", "usable_with_care"]
    assert any("30" in note for note in found.notes)


def test_black_boxes_answer_at_their_own_speeds(drives):
    found = tuners.schedule(black(), [*drives, drive(0.7, 20.0, 30)])
    assert found.alone and found.values.tolist() == list(SPEEDS)
    assert [len(result.logs) for result in found.results] == [0, 2, 0]
    truth = VEHICLE.oracle(np.array([[0.7, 120.0, v] for v in SPEEDS]))
    np.testing.assert_allclose(found.gains, truth, rtol=0.02)


@pytest.mark.slow
def test_where_the_plants_data_are_wrong_recordings_answer_alone():
    base = Task().vehicle
    other = replace(base, C_f=1.2 * base.C_f, J_z=0.85 * base.J_z)
    found = tuners.schedule(learned(), [drive(0.7, v, 40, vehicle=other) for v in SPEEDS])
    assert found.alone and found.values.tolist() == list(SPEEDS) and len(found.notes) > 1


@pytest.mark.slow
def test_a_plant_that_is_no_vehicle_has_a_schedule():
    """Over the gain K, which is measured; T is unknown and the same."""
    rng, given = np.random.default_rng(3), []
    for K in (0.6, 1.2, 1.8):
        y = gauged.respond(np.array([[K, 0.5]]))[0] + SIGMA * rng.standard_normal(len(U))
        given.append(Recording.of(gauged, U, y, TS, {"K": K}))
    tuner = tuners.train(FEW, gauged, episodes=200, seed=1)
    found = tuners.schedule(tuner, given, [0.6, 1.0, 1.8])
    truth = gauged.oracle(np.array([[K, 0.5] for K in found.values]))
    np.testing.assert_allclose(found.gains, truth, rtol=0.03)


def test_what_has_no_schedule_is_refused(drives):
    with pytest.raises(ValueError, match="recordings"):
        tuners.schedule(learned(), [])
    with pytest.raises(ValueError, match="values"):
        tuners.schedule(learned(), drives, [20.0, 12.0])
    with pytest.raises(ValueError, match="v_x"):
        tuners.schedule(learned(), drives, [5.0, 12.0])
    with pytest.raises(ValueError, match="parameter"):
        tuners.schedule(learned(), drives, parameter="mass")
    with pytest.raises(ValueError, match=r"recordings\[0\]"):
        tuners.schedule(black(), [replace(drives[0], known=None)])
    u = np.sin(np.arange(500))
    with pytest.raises(ValueError, match="measured"):
        tuners.schedule(tuners.load("gb", plant), [Recording.of(plant, u, u, TS)])
