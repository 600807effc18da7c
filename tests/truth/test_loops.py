"""Loops of many plants: the design rule meets its target, and bad gains are unstable."""

import dataclasses

import numpy as np
import pytest
from systems import contexts, gains

from yawrate_env.batch import take
from yawrate_env.loop.target import Target
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.task import Task

TASKS = {
    "pi": Task(),
    "printed": Task(target=Target(phase_margin=40.0, controller="printed")),
    "delay": Task(target=Target(delay_samples=2)),
}


@pytest.mark.parametrize("name", TASKS)
def test_the_design_rule_meets_its_target(name):
    target, vehicles = TASKS[name].target, loops(TASKS[name], contexts(50, seed=0))
    oracle = vehicles.design()
    reachable = oracle.status == 0
    found = vehicles.evaluate(oracle.kp, oracle.Ti).margins
    assert reachable.sum() >= 10
    np.testing.assert_allclose(found.phase_margin[reachable], target.phase_margin, rtol=1e-8)
    np.testing.assert_allclose(found.crossover[reachable], target.crossover, rtol=1e-8)


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


@pytest.mark.parametrize("name", TASKS)
@pytest.mark.parametrize("count", [1, 17])
def test_one_loop_is_evaluated_alike_in_any_batch(name, count):
    context, (kp, Ti), part = contexts(40, seed=3), gains(40, seed=3), slice(11, 11 + count)
    together = loops(TASKS[name], context).evaluate(kp, Ti)
    alone = loops(TASKS[name], take(context, part)).evaluate(kp[part], Ti[part])
    np.testing.assert_array_equal(alone.stable, together.stable[part])
    for field in dataclasses.fields(alone.margins):
        a, b = getattr(alone.margins, field.name), getattr(together.margins, field.name)
        np.testing.assert_array_equal(a, b[part])
