"""The filter of parameters that walk and jump, against integrals on a grid."""

import numpy as np
from scipy.stats import norm

from tuners.recalibration.belief import Belief, Motion, follow, weighed
from tuners.recalibration.follower import Follower
from yawrate_env.signals.streams import stream
from yawrate_env.vehicle.drive_conditions import START_INTEGERS, WINDOW_INTEGERS
from yawrate_env.vehicle.drives import Drives


def test_without_jumps_it_is_the_kalman_filter():
    rng = np.random.default_rng(0)
    mean, walk = rng.standard_normal((5, 2)), rng.uniform(0.1, 1, (5, 2))
    covariance = np.tile([[1.0, 0.3], [0.3, 2.0]], (5, 1, 1))
    H, R = rng.standard_normal((2, 2)), np.diag([0.5, 0.2])
    z = rng.standard_normal((5, 2))
    F = np.tile(H.T @ np.linalg.inv(R) @ H, (5, 1, 1))
    found = follow(
        Belief(mean, covariance, np.zeros(5)),
        Motion(walk, 1e-300, 0, 0.0, 1.0),
        F,
        z @ np.linalg.inv(R) @ H,
    )
    for b in range(5):
        P = covariance[b] + np.diag(walk[b])
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        np.testing.assert_allclose(found.mean[b], mean[b] + K @ (z[b] - H @ mean[b]))
        np.testing.assert_allclose(found.covariance[b], P - K @ H @ P, atol=1e-12)


def test_two_hypotheses_have_the_moments_of_the_mixture():
    measured, deviation, walk, wide = np.linspace(-1.5, 4, 12), 0.3, 0.2, 2.0
    belief = Belief(np.zeros((12, 1)), np.full((12, 1, 1), 0.1), np.zeros(12))
    motion = Motion(np.full((12, 1), walk**2), 0.05, 0, 1.0, wide**2)
    information = np.full((12, 1, 1), deviation**-2)
    found = follow(belief, motion, information, measured[:, None] / deviation**2)
    z = np.linspace(-15, 15, 60_001)
    stay = 0.95 * norm.pdf(z, 0, np.sqrt(0.1 + walk**2))
    moved = 0.05 * norm.pdf(z, 1, wide)
    for b, y in enumerate(measured):
        likelihood = norm.pdf(y, z, deviation)
        weight = (stay + moved) * likelihood
        weight /= weight.sum()
        mean = weight @ z
        assert abs(found.mean[b, 0] - mean) < 1e-6
        assert abs(found.covariance[b, 0, 0] - weight @ (z - mean) ** 2) < 1e-6
        share = (moved * likelihood).sum() / ((stay + moved) * likelihood).sum()
        assert abs(found.jumped[b] - share) < 1e-6
    assert found.jumped.min() < 0.03 and found.jumped.max() > 0.999


def test_evidence_is_the_integral_over_both_hypotheses():
    measured, deviation, walk, wide = np.linspace(-1.5, 4, 12), 0.3, 0.2, 2.0
    belief = Belief(np.zeros((12, 1)), np.full((12, 1, 1), 0.1), np.zeros(12))
    motion = Motion(np.full((12, 1), walk**2), 0.05, 0, 1.0, wide**2)
    information = np.full((12, 1, 1), deviation**-2)
    _, found = weighed(belief, motion, information, measured[:, None] / deviation**2)
    z = np.linspace(-15, 15, 60_001)
    prior = 0.95 * norm.pdf(z, 0, np.sqrt(0.1 + walk**2)) + 0.05 * norm.pdf(z, 1, wide)
    for y, evidence in zip(measured, found, strict=True):
        exponent = z * (y - z / 2) / deviation**2  # but for what does not depend on z
        assert abs(np.log((prior * np.exp(exponent)).sum() * (z[1] - z[0])) - evidence) < 1e-6


def test_coordinates_that_are_not_live_stay():
    rng = np.random.default_rng(0)
    belief = Belief(rng.standard_normal((4, 3)), np.tile(np.eye(3), (4, 1, 1)), np.zeros(4))
    F, i = np.tile(np.eye(3), (4, 1, 1)), rng.standard_normal((4, 3))
    motion = Motion(np.zeros((4, 3)), 0.1, 0, 0.0, 1.0)
    found, _ = weighed(belief, motion, F, i, np.full(4, 2))
    np.testing.assert_array_equal(found.mean[:, 2], belief.mean[:, 2])
    np.testing.assert_array_equal(found.covariance[:, 2], belief.covariance[:, 2])
    assert (found.mean[:, :2] != belief.mean[:, :2]).all()


def drive(follower, windows, count, gains_of):
    """Squared errors (windows, count, 2) of crossover and margin, and unstable windows."""
    drives = follower.drives
    course = drives.begin(stream(20, 0, count, START_INTEGERS))
    belief, errors, lost, kept = follower.known(course.theta), [], 0, course.gains
    for t in range(windows):
        window = drives.coming(course, stream((21, t), 0, count, WINDOW_INTEGERS))
        gains = kept if gains_of is None else gains_of(belief, window.theta[:, 2])
        course, found = drives.window(course, window, gains)
        belief = follower.followed(belief, found.estimate)
        errors.append(found.metrics[:, :2] - found.wanted)
        lost += (~found.stable).sum()
    return np.abs(errors), lost


def test_the_followed_gains_keep_the_margins():
    follower = Follower.of(Drives.of())
    kept, _ = drive(follower, 25, 60, None)
    followed, lost = drive(follower, 25, 60, follower.gains)
    assert lost == 0
    assert (followed.mean(axis=(0, 1)) < kept.mean(axis=(0, 1)) / 5).all()
