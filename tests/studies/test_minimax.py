"""The minimax fit and its study."""

import numpy as np

from studies import minimax
from studies.minimax_fit import Minimax
from yawrate_env.plant.episodes import sample
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

PLANT = yaw_rate(Task())


def test_the_minimax_line_is_chebyshevs():
    # x^2 on [0, 1]: the best line in the largest error is x - 1/8, in the mean square x - 1/6.
    x = np.linspace(0.0, 1.0, 6400)[:, None]
    slopes, cells = np.ones((6400, 1, 1)), np.arange(6400) // 50
    worst, mean = (
        Minimax(1, rounds, 0.1).fit(x, x**2, slopes, cells)(x[[0, -1]])[:, 0]
        for rounds in (2000, 1)
    )
    np.testing.assert_allclose(worst, [-1 / 8, 7 / 8], atol=0.006)
    np.testing.assert_allclose(mean, [-1 / 6, 5 / 6], atol=1e-4)


def test_the_loss_is_that_of_the_slopes():
    # Only the sum of both targets counts: no constant reaches both, one sum is right.
    rng = np.random.default_rng(0)
    x, T = rng.standard_normal((500, 1)), rng.standard_normal((500, 2))
    T[:, 1] = 3 - T[:, 0]
    found = Minimax(1, rounds=1).fit(x, T, np.ones((500, 1, 2)), np.zeros(500, np.intp))
    np.testing.assert_allclose(found(x).sum(axis=1), 3.0, atol=1e-9)


def test_slopes_predict_metrics():
    theta = sample(PLANT, 20)
    right = PLANT.parametrisation.encode(PLANT.oracle(theta))
    slopes = minimax.slopes_of(PLANT, theta, right)
    step = np.array([1e-3, -2e-3])
    moved = PLANT.metric_values(theta, PLANT.parametrisation.decode(right + step))
    change = (moved - PLANT.targets(theta)) / minimax.SCALES
    np.testing.assert_allclose(slopes @ step, change, rtol=0.02, atol=1e-6)


def test_parts_cover_the_prior():
    low, high = PLANT.ranges
    ends = np.stack([low, high])
    assert minimax.parts_of(PLANT, ends).tolist() == [0, minimax.PARTS**2 - 1]
    parts = minimax.parts_of(PLANT, sample(PLANT, 2000))
    assert len(np.unique(parts)) == minimax.PARTS**2
