"""The study of re-calibration: its rungs in order, its page, and the agent."""

from dataclasses import replace

import numpy as np
import pytest

import tuners
from studies import recalibration, recalibration_agent, recalibration_page
from studies.recalibration import begun, interface, ladder, ride, row, trials
from studies.recalibration_faults import FAULTS
from yawrate_env.vehicle.drives import Drives


@pytest.fixture(scope="module")
def short():
    return replace(interface(Drives.of()), windows=12)


def test_rungs_are_in_order(short):
    start = begun(short.drives, 0, 80)
    found = {name: row(name, ride(short, rung, start, 0))
             for name, rung in ladder(short.drives, start).items()}  # fmt: skip
    order = ("never re-tune", "every window alone, with the prior", "filter", "one window late",
             "oracle")  # fmt: skip
    errors = [found[name]["phase_margin"]["mean"] for name in order]
    assert errors == sorted(errors, reverse=True) and errors[-1] < 1e-9
    bound, filtered = (found[name]["return"]["mean"] for name in ("information bound", "filter"))
    assert filtered < bound + 0.05
    assert all(each["windows"] == 960 and each["unstable"] == 0 for each in found.values())


@pytest.mark.slow
def test_tuners_answer_every_window_or_leave_gains_alone(short):
    start = begun(short.drives, 0, 2)
    two = replace(short, windows=2)
    rungs = trials(two.drives, start, {"bb": tuners.load("bb")})
    always, _, heeded = (ride(two, rung, start, 0) for rung in rungs.values())
    never = ride(two, ladder(two.drives, start)["never re-tune"], start, 0)
    np.testing.assert_array_equal(always.errors[:, 0], never.errors[:, 0])
    assert (always.errors[:, 1] != never.errors[:, 1]).all()
    np.testing.assert_array_equal(heeded.errors, never.errors)


def test_a_fault_is_in_the_drives_and_not_in_the_estimator():
    assumed = Drives.of()
    true = FAULTS["front stiffness − 10 %"].of(assumed)
    assert true.vehicle.C_f == pytest.approx(0.9 * assumed.vehicle.C_f)
    assert true.estimator == assumed.estimator
    assert FAULTS["gyro noise × 2"].of(assumed).conditions.noise > assumed.conditions.noise
    falling = FAULTS["front stiffness falls by 15 %"].drives(assumed, 49)
    assert falling.vehicle.C_f == pytest.approx(0.85 * assumed.vehicle.C_f)


def test_a_sensors_gain_is_in_loop_and_margins():
    usual, theta = Drives.of(), np.array([[0.8, 100.0, 20.0]])
    stronger = FAULTS["gyro gain + 10 %"].of(usual)
    first, second = (each.designed(theta)[0] for each in (usual, stronger))
    np.testing.assert_allclose(second, first / [1.1, 1], rtol=1e-6)


def test_a_policy_is_a_rung_that_keeps_the_gains_of_the_start_at_first(short):
    start = begun(short.drives, 0, 5)

    class Keeps:
        def predict(self, obs, state, episode_start, deterministic):
            assert obs.shape == (5, 9) and episode_start.all() == (state is None) and deterministic
            return np.full((5, 3), -1.0), (state or 0) + 1

    rung = recalibration_agent.Acting(Keeps(), short, start)
    kept = ride(short, rung, start, 0)
    never = ride(short, ladder(short.drives, start)["never re-tune"], start, 0)
    np.testing.assert_array_equal(kept.errors, never.errors)
    assert rung.state == short.windows - 1


@pytest.mark.slow
def test_the_agent_is_above_every_window_alone(short):
    start = begun(short.drives, 0, 60)
    alone = ladder(short.drives, start)["every window alone, with the prior"]
    agent = recalibration_agent.Acting(recalibration_agent.trained(6000, 0, True), short, start)
    own, others = (ride(short, rung, start, 0).rewards.mean() for rung in (agent, alone))
    assert own > 0.8 * others  # rewards are negative


def test_speed_and_page():
    speed = recalibration.speed(4, 1)
    assert sum(speed["shares"].values()) == pytest.approx(1)
    value = {"mean": 1.0, "low": 0.5, "high": 2.0}
    each = {"drives": 1, "windows": 50, "phase_margin": value, "crossover": value,
            "return": value, "cost": value, "unstable": 0}  # fmt: skip
    names = "never re-tune", "never, scheduled over speed", "filter"
    rows = [each | {"rung": name, "seconds": 1.0} for name in names]
    trust = dict.fromkeys(("usable", "usable_with_care", "refuse", "missed"), 0.25)
    trust |= {"wrong": 3, "of": 1234, "coverage": [0.9, 0.95], "half": [2.0, 0.05]}
    ways = "never", "scheduled", "filter, data as exact", "filter"
    fault = {"fault": "none", "trust": trust, **dict.fromkeys(ways, each)}
    page = recalibration_page.page(
        {"seed": 7, "learned": 9, "rows": rows, "faults": [fault], "speed": speed}
    )
    assert "| filter | 1 (0.5 to 2) |" in page and "seed 7" in page
    assert "| 3 of 1,234 | 90%, 95% |" in page
