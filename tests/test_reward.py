import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yawrate_env.loop.target import Target
from yawrate_env.plant.reward import margin_error, reward

TARGET = Target()
PHASE_MARGIN = st.floats(-180, 180) | st.just(np.nan)
CROSSOVER = st.floats(1e-9, 50) | st.just(np.nan)


def of(phase_margin, crossover, stable=True):
    return reward(*(np.atleast_1d(v) for v in (phase_margin, crossover, stable)), TARGET)


def test_zero_exactly_at_the_target():
    assert of(60.0, 1.5)[0] == 0
    assert (of([60.001, 59.999, 60.0], [1.5, 1.5, 1.50001]) < 0).all()


@pytest.mark.parametrize(
    ("phase_margin", "crossover", "error"),
    [(70.0, 1.5, 1.0), (60.0, 1.75, 1.0), (30.0, 2.5, 5.0), (100.0, 1.5, 4.0)],
)
def test_formula_by_hand(phase_margin, crossover, error):
    assert margin_error(phase_margin, crossover, TARGET) == pytest.approx(error)
    assert of(phase_margin, crossover)[0] == pytest.approx(-error / (1 + error / 4))


@given(PHASE_MARGIN, CROSSOVER, PHASE_MARGIN, CROSSOVER)
def test_every_unstable_loop_is_worth_less_than_every_stable_one(pm_1, fc_1, pm_2, fc_2):
    stable, unstable = of(pm_1, fc_1, True)[0], of(pm_2, fc_2, False)[0]
    assert unstable < stable
    assert -5 <= unstable and -4 <= stable <= 0


@given(st.floats(-180, 180), st.floats(1e-9, 50), st.floats(0, 0.999))
def test_a_smaller_error_is_worth_more(phase_margin, crossover, share):
    closer = 60 + share * (phase_margin - 60), 1.5 + share * (crossover - 1.5)
    near, far = of(*closer)[0], of(phase_margin, crossover)[0]
    error = margin_error(phase_margin, crossover, TARGET)
    assert near > far if error > 1e-9 else near >= far


def test_slope_at_the_target_is_one():
    step = 1e-6
    np.testing.assert_allclose(of([60 + 10 * step, 60], [1.5, 1.5 + 0.25 * step]), -step, rtol=1e-5)


def test_no_crossover_is_the_worst_of_the_stable():
    assert of(np.nan, np.nan)[0] == -4
    assert of(np.nan, np.nan, False)[0] == -5


def test_target_is_the_given_one():
    target = Target(phase_margin=45.0, crossover=2.0)
    assert reward(np.array([45.0]), np.array([2.0]), np.array([True]), target)[0] == 0
