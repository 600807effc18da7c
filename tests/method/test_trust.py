"""Predicted margins, intervals and the checks that decide on trust."""

import numpy as np
import pytest
from recordings import recorded

import tuners
from studies import faults
from studies.nonlinear import task_at
from tuners.cli.text import instead
from tuners.trust.black_box import black_box, functions_for
from tuners.trust.checks import GAUSSIAN, conformal
from tuners.trust.fit import fit, noise_level
from tuners.trust.vehicle_calibration import assessed, calibrate
from tuners.trust.vehicle_fallback import LEAST_DISTANCE, fallback, prior_grid
from tuners.trust.vehicle_trust import Calibration
from tuners.tuner.baselines import Oracle
from tuners.tuner.gray_box import GrayBox
from tuners.tuner.recording import Recording
from yawrate_env.loop.target import Target
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.episode import loops, record
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Prior, Task
from yawrate_env.vehicle.yaw_rate import theta_of, yaw_rate

RECORDING = recorded(8)
TASK = Task()


def scaled_errors(task, recording, start):
    plant, truth = yaw_rate(task), theta_of(recording.context)
    model = black_box(plant, functions_for(plant), recording.u, recording.y, start)
    found = fit(plant, model, recording.y, np.repeat(plant.middle, len(recording), axis=0))
    np.testing.assert_array_equal(found.theta[:, 2], truth[:, 2])
    error = (found.theta - truth)[:, :2] / plant.width
    return np.einsum("bi,bij,bj->b", error, np.linalg.inv(found.covariance), error)


@pytest.mark.parametrize("start", ["rest", "unknown"])
def test_the_fitted_vehicle_is_as_far_off_as_its_covariance_says(start):
    distance = scaled_errors(TASK, recorded(100), start)
    # Chi-square of two degrees of freedom: mean 2, standard deviation of the mean 0.2.
    assert 1.4 < distance.mean() < 2.6


def test_noise_that_counts_is_noise_around_the_crossover():
    rng = np.random.default_rng(0)
    white = rng.standard_normal((20, 10_000))
    np.testing.assert_allclose(noise_level(white, 0.001, 1.5), (white**2).mean(axis=1))
    held = np.repeat(white[:, :1000], 10, axis=1)  # as if interpolated: ten times the power there
    assert 6 < (noise_level(held, 0.001, 1.5) / (held**2).mean(axis=1)).mean() < 14


@pytest.mark.parametrize("name", ["ts-ff-lag", "ts-ff", "ts-gbm", "gb"])
def test_what_is_predicted_is_what_happens(name):
    tuner = tuners.load(name)
    design, found = tuner.assess(RECORDING)
    actual = loops(TASK, RECORDING.context).evaluate(design.kp, design.Ti).margins
    true = np.stack([actual.phase_margin, actual.crossover], axis=1)
    assert (np.abs(found.metrics - true) < 4 * found.spread).all()
    assert found.trusted.all()


def test_trust_asks_the_twin_that_the_tuner_was_made_for():
    task = task_at(4.0)
    draw = CONTEXT_SETS["test"].draw(task.prior, 0, 0, 24)
    u, y = record(task, draw)
    driven = Recording(u, np.asarray(y), task.experiment.Ts, draw.context.v_x, draw.context)
    right, found = Oracle(task).assess(driven)
    np.testing.assert_allclose(found.fit.theta[:, 0], draw.context.mu_s, rtol=0.03)
    assert found.trusted.all() and (right.status == 0).all()
    assert not GrayBox(task).assess(driven)[1].trusted.any()  # its own model is the linear one
    assert not Oracle(Task(experiment=task.experiment)).assess(driven)[1].trusted.any()


def test_one_answer_is_put_in_words():
    result = tuners.load("nominal").tune(RECORDING.u[0], RECORDING.y[0], 0.001)
    assert not result.trusted and not all(check.passed for check in result.checks)
    assert any("miss the target" in reason for reason in result.reasons)
    assert result.phase_margin.low < result.phase_margin.value < result.phase_margin.high
    assert result.fit.from_rest and 28 < result.fit.snr_db < 32
    np.testing.assert_allclose(result.fit.measured, RECORDING.y[0], atol=1e-12)


def test_an_answer_from_mid_drive_at_100_hz():
    u, y = RECORDING.u[0, 2500::10], RECORDING.y[3, 2500::10] + 0.01
    result = tuners.load("ts-ff-lag").tune(u, y, 0.01)
    margins = loops(TASK, RECORDING.part(slice(3, 4)).context)(
        np.array([result.kp]), np.array([result.Ti])
    ).margins
    assert result.trusted and not result.fit.from_rest
    assert result.fit.offset == pytest.approx(0.01, abs=1e-3)
    assert abs(margins.phase_margin[0] - 60) < 0.5 and abs(margins.crossover[0] - 1.5) < 0.02
    assert any("Ts is 0.01 s" in note for note in result.notes)


def test_conformal_factors_hold_for_any_error():
    rng = np.random.default_rng(1)
    spread = rng.uniform(1, 3, (4000, 2))
    actual = spread * rng.standard_t(3, (4000, 2))
    factors = conformal(np.zeros((2000, 2)), spread[:2000], actual[:2000])
    inside = np.abs(actual[2000:]) <= spread[2000:] * factors
    # Standard error of the share: 0.7 % from each half.
    np.testing.assert_allclose(inside.mean(axis=0), 0.9, atol=0.03)


def test_calibration_of_the_gray_box_is_nearly_that_of_a_normal_error():
    tuner = tuners.load("gb")
    assert tuner.calibration == Calibration()
    calibrate(tuner, episodes=300)
    np.testing.assert_allclose(tuner.calibration.factors, GAUSSIAN, rtol=0.15)
    assert (tuner.calibration.episodes, tuner.calibration.seed) == (300, 0)


def test_a_calibration_survives_saving(tmp_path):
    tuner = tuners.load("ts-ff-lag")
    tuner.calibration = Calibration(1.5, 1.75, 3000, 4)
    tuner.save(tmp_path / "own.tuner")
    assert tuners.load(tmp_path / "own.tuner").calibration == tuner.calibration


@pytest.mark.parametrize("kind", list(faults.KINDS))
def test_gains_that_miss_are_not_trusted(kind):
    made = faults.KINDS[kind](TASK, np.random.default_rng(0), 8)
    design, found = tuners.load("ts-ff-lag").assess(made.recording)
    trusted = found.trusted
    for i, vehicle in enumerate(made.vehicle * (8 // len(made.vehicle))):
        one = Context(*(getattr(made.context, n)[i : i + 1] for n in Context.__slots__))
        verdict = loops(Task(vehicle), one).evaluate(design.kp[i : i + 1], design.Ti[i : i + 1])
        error = abs(verdict.margins.phase_margin[0] - 60), abs(verdict.margins.crossover[0] - 1.5)
        hit = error[0] <= 3 and error[1] <= 0.15 and verdict.stable[0]
        assert hit or not trusted[i]
    assert made.real or not trusted.any()


@pytest.mark.parametrize(
    "task",
    [
        TASK,
        Task(prior=Prior(v_x=(10.0, 33.0))),
        Task(target=Target(phase_margin=45.0, crossover=1.0, delay_samples=1)),
    ],
)
def test_the_fallback_is_stable_for_the_whole_prior(task):
    kp, Ti = fallback(task)
    everyone = prior_grid(task.prior, 25, 25, 25)
    verdict = loops(task, everyone).evaluate(np.full(len(everyone), kp), np.full(len(everyone), Ti))
    assert verdict.stable.all() and verdict.margins.modulus_margin.min() > LEAST_DISTANCE - 0.01


def test_where_no_gains_are_safe_for_everyone_that_is_said():
    hard = Task(target=Target(phase_margin=20.0, crossover=10.0, delay_samples=5))
    assert np.isnan(fallback(hard)).all()
    recording = recorded(1)
    result = GrayBox(hard).tune(recording.u[0], recording.y[0], 0.001)
    assert np.isnan(result.fallback).all() and np.isfinite(result.kp)
    assert "No gains are stable for every vehicle" in instead(result.fallback)


def test_assessments_come_in_parts_that_do_not_matter():
    tuner = tuners.load("ts-ff-lag")
    parts = list(assessed(tuner, "test", 130, 0))
    assert [len(block) for block, _, _ in parts] == [128, 2]
    margins = np.concatenate([actual for _, _, actual in parts])
    assert margins.shape == (130, 2) and np.abs(margins - [60, 1.5]).max() < 0.06


@pytest.mark.parametrize("factor", [-0.1, -1.0, np.nan, np.inf])
def test_a_calibration_factor_is_not_negative(factor):
    with pytest.raises(ValueError, match="calibration crossover = .* Calibrate again"):
        Calibration(crossover=factor)
