"""Feedback is found in recordings that do not say that they were made in a closed loop."""

from dataclasses import replace

import numpy as np
import pytest
from closed_loops import driven, judged

import tuners
from tuners.features.laguerre import Laguerre
from tuners.trust.feedback import rebuilt
from tuners.trust.findings import Findings
from tuners.trust.innovations import answers
from tuners.trust.verdict import Verdict
from tuners.tuner.recording import Recording
from yawrate_env.loop.target import Target
from yawrate_env.plant.episodes import recorded
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import BLACK_BOX, yaw_rate

FUNCTIONS = Laguerre(*BLACK_BOX)


def found(plant, u, y, Ts, reference=None):
    findings = Findings(plant, None).of_feedback(FUNCTIONS, u, y, Ts, reference)
    (finding,) = findings.values()
    return finding.values > finding.limit


@pytest.mark.parametrize("snr_db", [14.0, 40.0])
@pytest.mark.parametrize("N", [5000, 10000])
def test_open_loops_are_hardly_ever_taken_for_closed_ones(snr_db, N):
    experiment = Experiment(snr_db=snr_db, N=N, register="random")
    plant = yaw_rate(Task(prior=Prior(v_x=(10.0, 33.0)), experiment=experiment))
    made = recorded(plant, "test", 0, 256)
    assert found(plant, made.u, made.y, plant.Ts).mean() <= 0.01
    late = 50  # samples of 1 ms by which the log has the input late
    assert found(plant, made.u[:, :-late], made.y[:, late:], plant.Ts).mean() <= 0.01


def test_white_signals_that_know_nothing_of_each_other_have_normal_correlations():
    u, y = np.random.default_rng(0).standard_normal((2, 300, 1000))
    values = answers(u, u, y, 0.01, FUNCTIONS)
    assert values.std() == pytest.approx(1.0, abs=0.1)
    assert np.abs(values.mean()) < 0.1


def test_a_closed_loop_is_seen_said_and_refused():
    drives = driven(24, seed=4)
    tuner, plant = tuners.load("ts-ff-lag-vx"), tuners.load("ts-ff-lag-vx").plant
    seen = found(plant, drives.u, drives.y, 0.01)
    assert seen.mean() >= 0.8
    bad = ~judged(drives, tuner.assess(drives.recording)[0].values)
    results = tuner.results(drives.recording)
    assert not any(r.trusted for r, b in zip(results, bad, strict=True) if b)
    for result in (r for r, s in zip(results, seen, strict=True) if s):
        assert result.verdict is Verdict.REFUSE and result.left == ()
        assert {c.name for c in result.checks if c.message in result.reasons} <= {
            "feedback", "noise", "unsolved", "implausible"
        }  # fmt: skip


def test_a_rebuilt_reference_is_the_loops_and_another_controllers_is_not():
    drives, target = driven(24, seed=4), Target()
    plant = tuners.load("ts-ff-lag-vx").plant
    rows = list(zip(drives.u, drives.y, drives.gains, strict=True))
    exact = np.stack([rebuilt(u, y, 0.01, tuple(g), target) for u, y, g in rows])
    settled = slice(200, None)  # the integral at the start is unknown
    error = (exact - drives.reference)[:, settled].std(axis=1)
    assert (error < 1e-3 * drives.reference.std(axis=1)).all()
    other = np.stack([rebuilt(u, y, 0.01, (1.5 * g[0], g[1]), target) for u, y, g in rows])
    assert not found(plant, drives.u, drives.y, 0.01, drives.reference).any()
    assert found(plant, drives.u, drives.y, 0.01, other).mean() > 0.8


def test_a_faster_log_has_the_controllers_samples_among_its_own():
    drives, target = driven(24, seed=4), Target()
    u, y, reference = drives.u[0], drives.y[0], drives.reference[0]
    rng = np.random.default_rng(0)
    fine = np.repeat(y, 10) + 1e-3 * rng.standard_normal(10 * len(y))
    fine[3::10] = y  # between them the output is another
    held = np.concatenate([np.full(3, u[0]), np.repeat(u, 10)])[: len(fine)]
    again = rebuilt(held, fine, 0.001, tuple(drives.gains[0]), target)
    np.testing.assert_allclose(again[2003::10], reference[200:], atol=1e-6)
    with pytest.raises(ValueError, match="Ts"):
        rebuilt(u, y, 0.015, (0.1, 0.1), target)


def test_with_the_old_gains_a_loop_is_tuned_as_with_its_reference():
    drives = driven(24, seed=4)
    tuner = tuners.load("ts-ff-lag-vx")
    some = Recording(drives.u, drives.y, 0.01, drives.known).part(slice(0, 6))
    rows = zip(some.u, some.y, drives.gains[:6], strict=True)
    again = np.stack([rebuilt(u, y, 0.01, tuple(g), Target()) for u, y, g in rows])
    rebuilt_gains, by_old = tuner.assess(replace(some, reference=again))
    given_gains, by_given = tuner.assess(replace(some, reference=drives.reference[:6]))
    np.testing.assert_allclose(rebuilt_gains.values, given_gains.values, rtol=0.1)
    np.testing.assert_array_equal(by_old.trusted, by_given.trusted)
