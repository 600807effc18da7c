"""Boosted trees: settings, scaling and storage."""

import dataclasses
import json

import numpy as np
import pytest

from tuners.learners.gbm import GBM, GBMSettings

SMALL = {"n_estimators": 30, "min_child_weight": 2.0}


def toy(seed=0, count=300):
    X = np.random.default_rng(seed).uniform(-1, 1, (count, 4))
    return X, np.stack([np.sin(3 * X[:, 0]) + X[:, 1], 1e-3 * np.exp(X[:, 2]) + 5], axis=1)


def trained(X, T, X_val=None, T_val=None, random_state=0, progress=None, **settings):
    none = np.empty((0, 4)), np.empty((0, 2))
    X_val, T_val = none if X_val is None else (X_val, T_val)
    return GBMSettings(**SMALL | settings).fit([(X, T)], [(X_val, T_val)], random_state, progress)


def parameters(model):
    config = json.loads(model.save_config())["learner"]["gradient_booster"]["tree_train_param"]
    names = ("eta", "lambda", "max_depth", "max_leaves", "min_child_weight")
    return {name: float(config[name]) for name in names}


@pytest.mark.parametrize("depth, leaves", [(7, 10), (3, 5), (2, 0)])
def test_settings_reach_xgboost(depth, leaves):
    gbm = trained(*toy(), max_depth=depth, max_leaves=leaves, n_estimators=12,
                  learning_rate=0.2, reg_lambda=0.5)  # fmt: skip
    assert len(gbm.models) == 2
    for model in gbm.models:
        assert model.num_boosted_rounds() == 12
        trees = model.get_dump()
        counts = [tree.count("leaf=") for tree in trees]
        assert max(counts) == min(leaves or 2**depth, 2**depth)
        assert max(line.count("\t") for tree in trees for line in tree.splitlines()) <= depth
        expected = {"eta": 0.2, "lambda": 0.5, "min_child_weight": 2.0}
        expected |= {"max_depth": depth, "max_leaves": leaves}
        assert parameters(model) == pytest.approx(expected)


def test_defaults_are_the_papers():
    expected = {"n_estimators": 2000, "max_depth": 7, "max_leaves": 10}
    expected |= {"learning_rate": 0.1, "reg_lambda": 4.0, "min_child_weight": 25.0}
    assert dataclasses.asdict(GBMSettings()) == expected


def test_learns_both_targets():
    gbm = trained(*toy(), n_estimators=200)
    X, T = toy(seed=1)
    residual = (gbm(X) - T).std(axis=0) / T.std(axis=0)
    assert (residual < 0.2).all()


def test_training_is_repeatable_and_leaves_validation_alone():
    X, T = toy()
    np.testing.assert_array_equal(trained(X, T)(X), trained(X, T)(X))
    np.testing.assert_array_equal(trained(X, T, X[:20], T[:20])(X), trained(X, T)(X))


def test_a_constant_target_is_predicted():
    X, T = toy()
    T[:, 1] = 0.3
    np.testing.assert_allclose(trained(X, T)(X)[:, 1], 0.3, rtol=1e-12)


def test_arrays_round_trip_exactly():
    X, T = toy()
    gbm = trained(X, T)
    saved = gbm.arrays()
    assert set(saved) == {"mean", "scale", "model0.ubj", "model1.ubj"}
    again = GBM.from_arrays(saved)
    np.testing.assert_array_equal(again(X), gbm(X))
    assert again(X).dtype == np.float64 and again(X).shape == T.shape


def test_progress_counts_the_models():
    calls = []
    trained(*toy(), progress=lambda done, of: calls.append((done, of)))
    assert calls == [(1, 2), (2, 2)]
