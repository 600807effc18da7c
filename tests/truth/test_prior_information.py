"""The prior counts as information: what a recording does not show leaves the rest as it is."""

import numpy as np
import pytest
from first_order import described

import tuners
from tuners.trust.identification import UNIFORM, drawn_to_prior, inverse_of, output_slopes
from tuners.trust.intervals import GAUSSIAN
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.excitation import prbs

TS, LEVEL = 2.0, 8.0
INPUT = 4 + prbs(N=500, Ts=TS, bit_time=40.0, amplitude=2.0)[0]


def test_precisions_of_recording_and_prior_add_up():
    slopes = np.random.default_rng(0).standard_normal((5, 3, 40))
    noise = np.array([1e-6, 0.01, 1.0, 100.0, 1e4])
    gram = slopes @ slopes.swapaxes(1, 2)
    inverse, covariance = drawn_to_prior(slopes, noise)
    precision = gram / noise[:, None, None] + 12 * np.eye(3)
    np.testing.assert_allclose(covariance, np.linalg.inv(precision), rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(covariance, noise[:, None, None] * inverse, rtol=1e-9, atol=1e-15)
    # Much information hides the prior, and none leaves it.
    bare = noise[0] * inverse_of(slopes[:1])[0]
    np.testing.assert_allclose(covariance[0], bare, rtol=1e-3, atol=1e-3 * bare.max())
    for sigma in (0.0, 1.0):
        np.testing.assert_allclose(drawn_to_prior(0 * slopes, sigma + 0 * noise)[1][0],
                                   UNIFORM * np.eye(3))  # fmt: skip


def test_only_the_sum_of_two_alike_is_known():
    one = np.random.default_rng(1).standard_normal(40)
    slopes, noise = np.stack([one, one])[None], np.array([0.01])
    covariance = drawn_to_prior(slopes, noise)[1][0]
    total, difference = np.array([1.0, 1.0]), np.array([1.0, -1.0])
    assert difference @ covariance @ difference == pytest.approx(2 * UNIFORM)
    known = 1 / (one @ one / noise[0] + 6)
    assert total @ covariance @ total == pytest.approx(known)


def overflowing(theta, u, rng):
    """A lag that overflows above a level, which not every plant reaches."""
    K, T, spill = theta.T
    u = np.broadcast_to(u, (len(theta), np.shape(u)[-1]))
    y, x = np.empty(u.shape), np.zeros(len(theta))
    for k in range(u.shape[1]):
        y[:, k] = x
        x = x + TS * ((K * u[:, k] - x) / T - spill * np.maximum(x - LEVEL, 0.0))
    return y


@pytest.fixture(scope="module")
def overflow():
    plant = Plant(
        prior={"K": (0.5, 2.0), "T": (40.0, 200.0), "spill": (0.0, 0.2)},
        simulate=overflowing,
        design=lambda t: np.stack([t[:, 1] / (30 * t[:, 0]), t[:, 1]], axis=1),
        gains=("kp", "Ti"), u=INPUT, Ts=TS, noise=0.05,
    )  # fmt: skip
    return tuners.train(plant, episodes=100, calibration=100)


@pytest.mark.parametrize("theta", [(1.2, 90.0, 0.1), (0.8, 90.0, 0.1)])
def test_a_parameter_that_shows_in_some_plants_only(overflow, theta):
    plant = overflow.plant
    assert (np.array(overflow.calibration) < 3 * GAUSSIAN).all()
    clean = plant.respond(np.array([theta]))[0]
    noise = 0.05 * np.random.default_rng(2).standard_normal(len(INPUT))
    found = overflow.tune(INPUT, clean + noise)
    assert found.trusted
    shows = clean.max() > LEVEL
    assert (found.fit.deviations["spill"] < 0.1 * 0.2) == shows
    assert any("spill" in note for note in found.notes) != shows
    np.testing.assert_allclose(
        list(found.gains.values()), plant.oracle(np.array([theta]))[0], rtol=0.05
    )


def test_determined_parameters_are_as_certain_as_without_a_prior():
    plant = described()
    theta = plant.middle
    slopes, noise = output_slopes(plant, theta), plant.sigma(plant.respond(theta)) ** 2
    bare = noise[0] * inverse_of(slopes)[0]
    covariance = drawn_to_prior(slopes, noise)[1][0]
    np.testing.assert_allclose(np.diag(covariance), np.diag(bare), rtol=0.01)
