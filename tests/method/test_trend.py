"""The trend before the learner."""

import numpy as np
import pytest

from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.gbm import GBMSettings
from tuners.learners.trend import Trend, TrendSettings

STUMPS = GBMSettings(n_estimators=5, max_depth=1, max_leaves=0, learning_rate=0.1)


def data(rows=400, seed=0):
    """Targets that are a quadratic of badly scaled, nearly dependent features."""
    rng = np.random.default_rng(seed)
    z = rng.standard_normal((rows, 3))
    X = np.column_stack([z[:, 0], z[:, 0] + 1e-3 * z[:, 1], 1e4 * z[:, 2], np.full(rows, 7.0)])
    T = np.column_stack([z[:, 0] * z[:, 1] + z[:, 2], 1 + z[:, 1] ** 2])
    return X, T


def test_a_quadratic_is_a_trend_and_leaves_nothing_to_the_learner():
    (X, T), (X_val, T_val) = data(), data(seed=1)
    model = TrendSettings(STUMPS, degree=2).fit([(X, T)], [(X_val, T_val)], 0)
    np.testing.assert_allclose(model(X_val), T_val, atol=1e-6)
    linear = TrendSettings(STUMPS, degree=1).fit([(X, T)], [(X_val, T_val)], 0)
    assert np.abs(linear(X_val) - T_val).max() > 0.5


def test_the_learner_sees_decorrelated_features():
    (X, T), (X_val, T_val) = data(), data(seed=1)
    model = TrendSettings(STUMPS).fit([(X, T)], [(X_val, T_val)], 0)
    inputs = model.polynomial.inputs(X)
    assert inputs.shape == (400, 3)  # the constant column says nothing
    np.testing.assert_allclose(inputs.T @ inputs / 400, np.eye(3), atol=1e-6)


@pytest.mark.parametrize("rest", [STUMPS, FeedForwardSettings(neurons=3, epochs=5)])
def test_data_in_parts_make_the_same_model(rest):
    (X, T), (X_val, T_val) = data(), data(seed=1)
    settings = TrendSettings(rest, degree=2)
    whole = settings.fit([(X, T)], [(X_val, T_val)], 0)
    parts = [(X[i : i + 150], T[i : i + 150]) for i in range(0, 400, 150)]
    same = settings.fit(parts, [(X_val, T_val)], 0)
    np.testing.assert_allclose(same(X_val), whole(X_val), atol=1e-5)


@pytest.mark.parametrize("rest", [STUMPS, FeedForwardSettings(neurons=3, epochs=5)])
def test_arrays_round_trip_exactly(rest):
    (X, T), (X_val, T_val) = data(), data(seed=1)
    model = TrendSettings(rest, degree=2).fit([(X, T)], [(X_val, T_val)], 0)
    np.testing.assert_array_equal(Trend.from_arrays(model.arrays())(X_val), model(X_val))
