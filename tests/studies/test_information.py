"""Information left in averages and features, against linear algebra and the whole of it."""

import numpy as np
import pytest

from studies.draws import draw
from studies.information import after_averaging, in_armax, in_laguerre
from tuners.features.laguerre import Laguerre
from tuners.trust.bound import parameter_covariance
from tuners.trust.identification import output_slopes
from yawrate_env.vehicle.task import Experiment, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

PLANT = yaw_rate(Task())
DRAWN = draw(PLANT, "test", 0, 0, 4)
EPISODES = DRAWN.theta, DRAWN.u


def shares(part, theta=DRAWN.theta, u=DRAWN.u, plant=PLANT):
    """Share of the information that is left in the worst and in the best direction, (B, 2)."""
    whole = np.linalg.inv(parameter_covariance(plant, theta, u))
    return np.sort(np.linalg.eigvals(np.linalg.solve(whole, part)).real, axis=1)


@pytest.fixture(params=["same", "random"])
def drawn(request):
    plant = yaw_rate(Task(experiment=Experiment(register=request.param)))
    found = draw(plant, "test", 0, 0, 3)
    return plant, found.theta, found.u


def test_averages_of_single_samples_keep_everything(drawn):
    plant, theta, u = drawn
    kept = shares(after_averaging(plant, theta, u, 1), theta, u, plant)
    np.testing.assert_allclose(kept, 1, rtol=1e-6)


def test_longer_averages_keep_less():
    kept = [shares(after_averaging(PLANT, *EPISODES, block)) for block in (10, 40, 160)]
    assert (kept[0] < 1).all() and (kept[1] < kept[0]).all() and (kept[2] < kept[1]).all()
    assert (kept[1] > 0.9).all()


def test_laguerre_coefficients_keep_what_their_regressors_span(drawn):
    plant, theta, u = drawn
    stage, S = Laguerre(6, 12.0), output_slopes(plant, theta, u)
    variance = (plant.respond(theta, u) ** 2).mean(axis=1) / 1000
    found = in_laguerre(plant, theta, u, stage)
    for b in range(len(theta)):
        Q, _ = np.linalg.qr(stage.regressors(u[[b % len(u)]], plant.Ts)[0].T)
        np.testing.assert_allclose(found[b], (S[b] @ Q) @ (S[b] @ Q).T / variance[b], rtol=1e-6)


def test_more_functions_keep_more_and_in_the_end_everything():
    kept = [shares(in_laguerre(PLANT, *EPISODES, Laguerre(n, 12.0))) for n in (4, 8, 20)]
    assert (kept[0] < kept[1]).all() and (kept[1] < kept[2]).all()
    np.testing.assert_allclose(kept[2], 1, rtol=1e-4)


class Sums:
    """Six weighted sums of 250 averages, for which everything is known."""

    Ts = 0.04
    weights = np.random.default_rng(1).standard_normal((250, 6))

    def __call__(self, u, y, Ts):
        return y @ self.weights, np.ones(len(y), bool)


def test_recordings_tell_what_linear_algebra_does_of_linear_features():
    theta, W = DRAWN.theta[:2], Sums.weights
    found = in_armax(PLANT, theta, DRAWN.u, Sums(), recordings=4000)
    variance = (PLANT.respond(theta) ** 2).mean(axis=1) / 1000 / 40
    slopes = output_slopes(PLANT, theta).reshape(2, 2, 250, 40).mean(axis=3)
    for b in range(2):
        D = W.T @ slopes[b].T
        expected = D.T @ np.linalg.solve(W.T @ W, D) / variance[b]
        ratio = np.linalg.eigvals(np.linalg.solve(expected, found[b])).real
        # 4000 recordings: a standard error of 2.2 % for a variance.
        np.testing.assert_allclose(ratio, 1, atol=0.08)
