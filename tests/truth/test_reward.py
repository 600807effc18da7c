"""The reward of scaled errors: its formula, its slope, and its order."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yawrate_env.plant.reward import distance, error_of, reward

ERROR = st.floats(-500, 500) | st.just(np.inf)


def of(*scaled):
    return reward(np.atleast_2d(np.array(scaled, dtype=float)))[0]


def test_zero_exactly_at_the_target():
    assert of(0.0, 0.0) == 0
    assert max(of(1e-4, 0.0), of(-1e-4, 0.0), of(0.0, 1e-5)) < 0


@pytest.mark.parametrize(
    ("scaled", "error"), [((1, 0), 1), ((0, -1), 1), ((-3, 4), 5), ((4, 0), 4), ((2, -2, 1), 3)]
)
def test_formula_by_hand(scaled, error):
    assert distance(np.array([scaled], dtype=float))[0] == pytest.approx(error)
    assert of(*scaled) == pytest.approx(-error / (1 + error / 4))


@given(ERROR, ERROR, ERROR)
def test_every_unstable_loop_is_worth_less_than_every_stable_one(first, second, other):
    stable, unstable = of(first, second), of(np.nan, other)
    assert unstable == -5 < -4 <= stable <= 0


@given(st.floats(-180, 180), st.floats(-50, 50), st.floats(0, 0.999))
def test_a_smaller_error_is_worth_more(first, second, share):
    near, far = of(share * first, share * second), of(first, second)
    assert near > far if np.hypot(first, second) > 1e-9 else near >= far


@given(st.floats(0, 12))
def test_errors_are_found_again_from_rewards_up_to_the_farthest(error):
    assert error_of(reward(np.array([[error]])))[0] == pytest.approx(error, abs=1e-9)


def test_worse_rewards_count_as_the_farthest():
    np.testing.assert_allclose(error_of(np.array([-3.0, -4.0, -5.0])), 12.0)


def test_an_undefined_metric_is_the_worst_of_the_stable():
    assert of(np.inf, 0.0) == -4
