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


@pytest.mark.parametrize(("name", "phase_margin"), [("pi", 60), ("printed", 40)])
def test_the_oracle_is_judged_perfect(name, phase_margin):
    judge = loops(TASKS[name], contexts(50, seed=0))
    oracle = judge.design()
    reachable = oracle.status == 0
    verdict = judge.evaluate(oracle.kp, oracle.Ti)
    assert reachable.sum() >= 10
    np.testing.assert_allclose(verdict.margins.phase_margin[reachable], phase_margin, rtol=1e-8)
    np.testing.assert_allclose(verdict.reward[reachable], 0, atol=1e-8)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
@pytest.mark.parametrize("position", [0, 1])
def test_gains_that_are_not_positive_numbers_count_as_unstable(bad, position):
    pair = [np.array([0.2, 0.2]), np.array([0.2, 0.2])]
    pair[position][0] = bad
    verdict = loops(Task(), contexts(2, seed=1)).evaluate(*pair)
    assert verdict.stable.tolist() == [False, True]
    assert verdict.reward[0] == -5 < verdict.reward[1]
    for name in verdict.margins.__slots__:
        assert np.isnan(getattr(verdict.margins, name)).tolist() == [True, False]


def test_unreachable_designs_are_judged_without_a_warning():
    judge = loops(Task(target=Target(phase_margin=5.0, crossover=0.5)), contexts(20, seed=2))
    oracle = judge.design()
    lost = np.isnan(oracle.kp)
    assert lost.any()
    assert (judge.evaluate(oracle.kp, oracle.Ti).reward[lost] == -5).all()


@pytest.mark.parametrize("name", TASKS)
@pytest.mark.parametrize("count", [1, 3, 17])
def test_one_verdict_does_not_depend_on_the_batch(name, count):
    context, (kp, Ti), part = contexts(40, seed=3), gains(40, seed=3), slice(11, 11 + count)
    together = loops(TASKS[name], context).evaluate(kp, Ti)
    alone = loops(TASKS[name], take(context, part)).evaluate(kp[part], Ti[part])
    np.testing.assert_array_equal(alone.reward, together.reward[part])
    np.testing.assert_array_equal(alone.stable, together.stable[part])
    for field in dataclasses.fields(alone.margins):
        a, b = getattr(alone.margins, field.name), getattr(together.margins, field.name)
        np.testing.assert_array_equal(a, b[part])
