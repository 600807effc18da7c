"""Feedback is found in recordings that do not say that they were made in a closed loop."""

from functools import cache

import numpy as np
import pytest

import tuners
from studies.closed_loops import driven
from tuners.features.laguerre import Laguerre
from tuners.trust.feedback import rebuilt
from tuners.trust.findings import Findings
from tuners.trust.innovations import answers
from tuners.trust.verdict import Verdict
from yawrate_env.loop.target import Target
from yawrate_env.plant.episodes import recorded
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import BLACK_BOX, yaw_rate

FUNCTIONS = Laguerre(*BLACK_BOX)


@cache
def looped():
    """Drives of every kind under bad controllers."""
    return driven(24, seed=4)


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
    drives = looped()
    tuner = tuners.load("ts-ff-lag-vx")
    seen = found(tuner.plant, drives.u, drives.y, 0.01)
    assert seen.mean() >= 0.9
    results = tuner.results(drives.recording("neither"))
    gains = np.array([list(result.gains.values()) for result in results])
    trusted = np.array([result.trusted for result in results])
    assert not (trusted & ~drives.good(gains)).any()
    for result in (r for r, s in zip(results, seen, strict=True) if s):
        assert result.verdict is Verdict.REFUSE and result.left == ()
        assert {c.name for c in result.checks if c.message in result.reasons} <= {
            "feedback", "noise", "unsolved", "implausible"
        }  # fmt: skip


def test_a_rebuilt_reference_is_the_loops_and_another_controllers_is_not():
    drives, target = looped(), Target()
    plant = tuners.load("ts-ff-lag-vx").plant
    rows = list(zip(drives.u, drives.y, drives.gains, strict=True))
    exact = drives.recording("old gains").reference
    settled = slice(200, None)  # the integral at the start is unknown
    error = (exact - drives.reference)[:, settled].std(axis=1)
    assert (error < 1e-3 * drives.reference.std(axis=1)).all()
    other = np.stack([rebuilt(u, y, 0.01, (1.5 * g[0], g[1]), target) for u, y, g in rows])
    assert not found(plant, drives.u, drives.y, 0.01, drives.reference).any()
    assert found(plant, drives.u, drives.y, 0.01, other).mean() > 0.8


def test_a_faster_log_has_the_controllers_samples_among_its_own():
    drives, target = looped(), Target()
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
    tuner, drives = tuners.load("ts-ff-lag-vx"), looped()
    some = [0, 1, 3, 4]  # a slow weave tells too little of the crossover
    assert {drives.manoeuvre[i] for i in some} == {"steps", "lane changes"}
    by_old, old = tuner.assess(drives.recording("old gains").part(some))
    by_given, given = tuner.assess(drives.recording("reference").part(some))
    np.testing.assert_allclose(by_old.values, by_given.values, rtol=0.1)
    np.testing.assert_array_equal(old.trusted, given.trusted)


def test_a_slow_weave_says_that_it_tells_little_of_the_crossover():
    tuner, drives = tuners.load("ts-ff-lag-vx"), looped()
    weaves = [i for i, kind in enumerate(drives.manoeuvre) if kind == "slow weave"][:4]
    _, given = tuner.assess(drives.recording("reference").part(weaves))
    widest = tuner.plant.metric_setting("widest")
    assert (1.645 * given.spread > widest).any(axis=1).all()
    assert not given.trusted.any()
