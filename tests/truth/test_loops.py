"""Loops of many plants: the design rule meets its target, and bad gains are unstable."""

import numpy as np
import pytest
from systems import contexts

from yawrate_env.loop.target import Target
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.task import Task


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
@pytest.mark.parametrize("position", [0, 1])
def test_gains_that_are_not_positive_numbers_count_as_unstable(bad, position):
    pair = [np.array([0.2, 0.2]), np.array([0.2, 0.2])]
    pair[position][0] = bad
    found = loops(Task(), contexts(2, seed=1)).evaluate(*pair)
    assert found.stable.tolist() == [False, True]
    for name in found.margins.__slots__:
        assert np.isnan(getattr(found.margins, name)).tolist() == [True, False]


def test_unreachable_designs_are_evaluated_without_a_warning():
    vehicles = loops(Task(target=Target(phase_margin=5.0, crossover=0.5)), contexts(20, seed=2))
    oracle = vehicles.design()
    lost = np.isnan(oracle.kp)
    assert lost.any()
    assert not vehicles.evaluate(oracle.kp, oracle.Ti).stable[lost].any()
