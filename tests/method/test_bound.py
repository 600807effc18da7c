"""The Cramer-Rao bound against closed forms, exact slopes and an efficient estimator."""

from dataclasses import replace

import numpy as np
import pytest
from families import FAMILIES, SHORT, VEHICLE
from first_order import SIGMA, slopes
from first_order import plant as lag

from tuners.trust.bound import cramer_rao, parameter_covariance
from tuners.tuner.recording import Recording
from tuners.tuner.rivals import GrayBox
from yawrate_env.plant.episodes import Draw, integers_of, recorded, sample
from yawrate_env.signals.streams import stream
from yawrate_env.vehicle.sensitivity import output_gram
from yawrate_env.vehicle.single_track import Vehicle, context_of
from yawrate_env.vehicle.task import Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

M_0 = Vehicle().M_0


def vehicles(**experiment):
    return yaw_rate(replace(VEHICLE, experiment=replace(SHORT, **experiment)))


def by_hand(theta):
    """Least standard deviations of the relative errors of T/(K TAU) and T."""
    d = slopes(theta)
    K, T = theta
    J = np.array([[-1 / K, 1 / T], [0.0, 1 / T]])
    return np.sqrt(np.diag(J @ np.linalg.inv(d @ d.T / SIGMA**2) @ J.T))


def test_the_bound_is_that_of_the_closed_form():
    theta = sample(lag, 5)
    np.testing.assert_allclose(cramer_rao(lag, theta), [by_hand(t) for t in theta], rtol=1e-4)
    width = np.array([1.5, 0.8])
    fisher = [np.linalg.inv(slopes(row) @ slopes(row).T) * SIGMA**2 for row in theta]
    by_width = parameter_covariance(lag, theta) * np.outer(width, width)
    np.testing.assert_allclose(by_width, fisher, rtol=1e-4)


@pytest.mark.parametrize("register", ["same", "random"])
def test_the_bound_by_differences_is_the_exact_one(register):
    """J F^-1 J^T with the exact sums over the outputs' sensitivities."""
    plant = yaw_rate(Task(experiment=replace(SHORT, register=register), prior=Prior(v_x=(10, 33))))
    draw = Draw.of(plant, stream((2, 0), 0, 5, integers_of(plant)))
    theta, clean = draw.theta, plant.respond(draw.theta, draw.u)
    gram = output_gram(Vehicle(), context_of(theta), draw.u, clean, plant.Ts, np.arange(5))
    sigma2 = (clean**2).mean(axis=1) / 1000  # 30 dB
    fisher = gram[:, 1:, 1:] / sigma2[:, None, None]

    def metrics(by_mu_s, by_mass):
        mass = (theta[:, 1] + M_0) * np.exp(by_mass) - M_0
        moved = np.stack([theta[:, 0] * np.exp(by_mu_s), mass, theta[:, 2]], axis=1)
        return plant.metric_values(theta, plant.oracle(moved))

    h = 1e-5
    J = np.stack([(metrics(h, 0) - metrics(-h, 0)), (metrics(0, h) - metrics(0, -h))], 2) / (2 * h)
    covariance = J @ np.linalg.inv(fisher) @ J.swapaxes(1, 2)
    expected = np.sqrt(np.einsum("bii->bi", covariance))
    # Central differences in steps of a thousandth of the prior.
    np.testing.assert_allclose(cramer_rao(plant, theta, draw.u), expected, rtol=1e-4)


def test_twenty_decibels_are_a_factor_of_ten():
    theta = sample(FAMILIES["vehicle"], 5)
    low, middle, high = (cramer_rao(vehicles(snr_db=s), theta) for s in (10.0, 30.0, 50.0))
    np.testing.assert_allclose(low, 10 * middle, rtol=1e-9)
    np.testing.assert_allclose(middle, 10 * high, rtol=1e-9)


def test_root_mean_square_over_the_prior_is_near_an_independent_programs():
    plant = yaw_rate(Task())
    spread = cramer_rao(plant, recorded(vehicles(), "test", 0, 128).theta)
    rms = np.sqrt((spread**2).mean(axis=0))
    # A prototype that shares no code found 0.0097 deg and 0.00037 Hz over other vehicles.
    np.testing.assert_allclose(rms, [0.0097, 0.00037], rtol=0.1)


@pytest.mark.parametrize("theta", [(0.35, 250.0, 20.0), (1.0, 50.0, 20.0)])
def test_the_gray_box_sits_on_the_bound(theta):
    plant, count = FAMILIES["vehicle"], 400
    same = np.tile(theta, (count, 1))
    keys = stream((2, 5), 0, count, integers_of(plant))[:, -4:]
    y = plant.measure(same, plant.u[None], keys, np.random.default_rng(0))
    found = GrayBox().gains(plant, Recording(plant.u[None], y, plant.Ts))
    errors, bound = plant.errors(same, found.values), cramer_rao(plant, same[:1])[0]
    assert found.converged.all()
    # Standard errors of 400 episodes: 3.5 % of a spread, 5 % of it for a mean.
    np.testing.assert_allclose(errors.std(axis=0), bound, rtol=4 * 0.035)
    assert (abs(errors.mean(axis=0)) < (4 * 0.05 + 0.1) * bound).all()
