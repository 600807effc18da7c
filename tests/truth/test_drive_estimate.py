"""Windows of drives: what they meet, and what they tell of friction and load."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from scipy.signal import lfilter

from yawrate_env.batch import take
from yawrate_env.loop.target import Target
from yawrate_env.signals.streams import stream
from yawrate_env.vehicle.drive_conditions import START_INTEGERS, WINDOW_INTEGERS, Conditions
from yawrate_env.vehicle.drive_estimate import encode
from yawrate_env.vehicle.drive_information import Noise, Predictor
from yawrate_env.vehicle.drives import Drives
from yawrate_env.vehicle.single_track import Vehicle
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

COUNT = 256
STEADY = Conditions(friction_walk=0.0, speed_walk=0.0, jump_every=1e12)
NOISE = Noise(STEADY.noise, STEADY.disturbance, STEADY.disturbance_time)


def started(drives, seed=1, count=COUNT):
    return drives.begin(stream(seed, 0, count, START_INTEGERS))


def integers(seed, count=COUNT):
    return stream(seed, 0, count, WINDOW_INTEGERS)


def driven(drives, course, windows, seed=2):
    """The last of some windows with the gains of the start, and where drives are then."""
    for t in range(windows):
        window = drives.coming(course, integers((seed, t), len(course)))
        course, found = drives.window(course, window, course.gains)
    return course, found


def test_friction_walks_jumps_and_stays_in_its_range():
    conditions = Conditions(speed_walk=0.0)
    theta = conditions.begin(stream(3, 0, COUNT, START_INTEGERS))
    path = [theta]
    for t in range(50):
        path.append(conditions.window_of(path[-1], integers((4, t))).theta)
    mu_s, M_delta, v_x = np.moveaxis(np.array(path), 2, 0)
    assert mu_s.min() >= 0.3 and mu_s.max() <= 1.1
    assert (M_delta == M_delta[0]).all() and (v_x == v_x[0]).all()
    steps = np.diff(mu_s, axis=0)
    inside = np.abs(mu_s[:-1] - 0.7) < 0.35
    walked = steps[inside & (np.abs(steps) < 0.03)]  # five deviations
    assert np.sqrt(12) * walked.std() == pytest.approx(0.02, rel=0.02)  # 12 windows a minute
    jumps = (np.abs(steps) > 0.05).sum()
    # 12,800 windows, one jump in 60; nine in ten go further than 0.05.
    assert 150 < jumps < 230


def test_a_car_meets_the_same_in_any_batch():
    conditions = Conditions()
    theta, drawn = conditions.begin(stream(5, 0, 40, START_INTEGERS)), integers(6, 40)
    whole = conditions.window_of(theta, drawn)
    part = conditions.window_of(theta[17:18], drawn[17:18])
    for name in ("theta", "reference", "white", "noise"):
        np.testing.assert_array_equal(getattr(whole, name)[17:18], getattr(part, name))


def test_references_are_comfortable_and_end_in_their_window():
    theta = Conditions().begin(stream(7, 0, COUNT, START_INTEGERS))
    window = Conditions().window_of(theta, integers(8))
    lateral = np.abs(window.reference).max(axis=1) * window.theta[:, 2]
    assert lateral.max() <= 3.0 + 1e-9 and lateral.min() > 0.1
    np.testing.assert_allclose(window.reference[:, -1], 0, atol=1e-12)


def test_disturbances_are_a_first_order_lag_of_white_noise():
    white = np.random.default_rng(0).standard_normal((3, 2000))
    share = np.exp(-0.01 / STEADY.disturbance_time)
    start = STEADY.disturbed(white[:, :1], np.full(3, np.nan))
    np.testing.assert_allclose(start[:, 0], STEADY.disturbance * white[:, 0])
    fresh = STEADY.disturbance * np.sqrt(1 - share**2)
    expected, _ = lfilter([fresh], [1, -share], white, zi=share * start)
    np.testing.assert_allclose(STEADY.disturbed(white, start[:, 0]), expected, atol=1e-12)


def test_predictors_are_scipys_stationary_kalman_filters():
    theta = STEADY.begin(stream(9, 0, 20, START_INTEGERS))
    found = Predictor.of(Vehicle(), theta, NOISE, 0.01)
    share = np.exp(-0.01 / NOISE.time)
    Q = np.zeros((7, 7))
    Q[6, 6] = NOISE.disturbance**2 * (1 - share**2)
    C = np.eye(7)[1:2]
    for A, K, variance in zip(found.A, found.K, found.variance, strict=True):
        P = solve_discrete_are(A.T, C.T, Q, [[NOISE.gyro**2]])
        expected = C @ P @ C.T + NOISE.gyro**2
        assert variance == pytest.approx(expected.item(), rel=1e-9)
        np.testing.assert_allclose(K, (A @ P @ C.T / expected)[:, 0], rtol=1e-7)


def test_the_compiled_predictor_is_the_textbook_recursion():
    drives = Drives.of(conditions=STEADY)
    course, found = driven(drives, started(drives, count=20), 1)
    predictor = Predictor.of(Vehicle(), found.theta, NOISE, 0.01)
    x = np.random.default_rng(1).standard_normal((20, 7)) * 1e-3
    gram, after = predictor.gram(found.u, found.y, x)
    squares = np.zeros(20)
    for u, y in zip(found.u.T, found.y.T, strict=True):
        e = y - x[:, 1]
        squares += e**2
        x = np.einsum("bij,bj->bi", predictor.A, x) + predictor.B * u[:, None]
        x += predictor.K * e[:, None]
    np.testing.assert_allclose(gram[:, 0, 0], squares / predictor.variance, rtol=1e-9)
    np.testing.assert_allclose(after, x, rtol=0, atol=1e-9 * np.abs(x).max())


def test_without_noise_the_estimate_is_the_vehicle():
    quiet = replace(STEADY, noise=1e-9, disturbance=1e-9)
    drives = Drives.of(conditions=quiet)
    course, _ = driven(drives, started(drives), 5)  # of two Gauss-Newton steps each
    np.testing.assert_allclose(course.start, encode(course.theta, Vehicle()), atol=1e-5)


def test_windows_tell_what_their_information_says():
    """At the true vehicle the score's covariance is the information; errors are white."""
    drives = Drives.of(conditions=STEADY)
    course, x, squares, misfits = started(drives), np.zeros((COUNT, 7)), [], []
    predictor = Predictor.of(Vehicle(), course.theta, NOISE, 0.01)
    for t in range(8):
        window = drives.coming(course, integers((10, t)))
        course, found = drives.window(course, window, course.gains)
        gram, x = predictor.gram(found.u, found.y, x)
        score = gram[:, 1:, 0]
        squares.append(np.einsum("bi,bij,bj->b", score, np.linalg.inv(gram[:, 1:, 1:]), score))
        misfits.append(gram[:, 0, 0])
    # 1,792 windows: chi-squared of 2 and of 500 degrees, whose means have deviations of 0.05
    # and 0.75.  The first windows begin at rest, which is not what the filter expects.
    assert np.mean(squares[1:]) == pytest.approx(2.0, abs=0.15)
    assert np.mean(misfits[1:]) == pytest.approx(500.0, abs=2.3)


@pytest.mark.parametrize("delay", [0, 2])
def test_estimates_scatter_somewhat_more_than_their_covariances_say(delay):
    drives = Drives.of(conditions=STEADY, target=Target(delay_samples=delay))
    course, squares = started(drives), []
    for t in range(8):
        course, found = drives.window(
            course, drives.coming(course, integers((10, t))), course.gains
        )
        F, i = found.estimate.information(drives.estimator.prior)
        error = np.linalg.solve(F, i[..., None])[..., 0] - encode(course.theta, Vehicle())
        squares.append(np.einsum("bi,bij,bj->b", error, F, error))
    assert 1.9 < np.mean(squares[2:]) < 3.2  # 2 if the slopes were those of the truth


def test_margins_are_those_of_the_environment():
    target = Target(delay_samples=1)
    drives = Drives.of(target=target)
    course, found = driven(drives, started(drives, count=64), 3)
    plant = yaw_rate(Task(target=target), check=False)
    metrics, stable = plant.evaluate(found.theta, found.gains)
    np.testing.assert_array_equal(found.metrics, metrics)
    np.testing.assert_array_equal(found.stable, stable)
    oracle, reached = plant.design(found.theta)
    np.testing.assert_array_equal(found.oracle, oracle)
    wanted, _ = plant.evaluate(found.theta, oracle)
    assert not reached.all()  # at high friction a sample of delay costs margin
    np.testing.assert_allclose(found.wanted, wanted[:, :2], rtol=1e-9)


def test_one_car_drives_the_same_in_any_batch():
    drives = Drives.of(target=Target(delay_samples=1))
    course = started(drives, count=40)
    alone = take(course, slice(23, 24))
    for t in range(3):
        drawn = integers((11, t), 40)
        course, whole = drives.window(course, drives.coming(course, drawn), course.gains)
        coming = drives.coming(alone, drawn[23:24])
        alone, one = drives.window(alone, coming, alone.gains)
        for name in ("u", "y", "metrics", "wanted", "oracle"):
            np.testing.assert_array_equal(getattr(whole, name)[23:24], getattr(one, name))
        for name in ("mean", "covariance", "misfit"):
            ours, theirs = getattr(whole.estimate, name), getattr(one.estimate, name)
            np.testing.assert_array_equal(ours[23:24], theirs)


@pytest.mark.parametrize("name", ["dead_time", "sensor_lag"])
def test_vehicles_with_a_lag_of_their_own_are_refused(name):
    with pytest.raises(ValueError, match=name):
        Drives.of(Vehicle(**{name: 0.01}))


@pytest.mark.parametrize(
    ("name", "value"),
    [("friction_walk", -1), ("jump_every", 0), ("window", np.nan), ("lane_changes", 2),
     ("mu_s", (1, 0)), ("v_x", 0)],
)  # fmt: skip
def test_conditions_are_checked(name, value):
    with pytest.raises(ValueError, match=name):
        Conditions(**{name: value})
