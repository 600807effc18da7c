import math

import numpy as np
import pytest
from systems import contexts

from yawrate_env.batch import take
from yawrate_env.loop import closed_loop
from yawrate_env.loop.target import Target
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.manoeuvre import double_lane_change
from yawrate_env.vehicle.nonlinear import NonlinearTwin
from yawrate_env.vehicle.nonlinear.time_domain import time_domain, time_response
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Task

TASK = Task(twin=NonlinearTwin())


def oracle(context, task=TASK):
    design = loops(task, context).design()
    return design.kp, design.Ti


@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize("form", ["pi", "printed"])
def test_small_references_see_the_linear_loop(form, delay):
    target = Target(controller=form, delay_samples=delay)
    task, context = Task(target=target, twin=NonlinearTwin()), contexts(20, seed=0)
    kp, Ti = np.full(20, 0.1), np.full(20, 0.3)
    _, reference = double_lane_change(target.Ts, 1e-4)
    y, u = time_response(task, context, kp, Ti, reference)
    plant = loops(task, context).plant
    expected_y, expected_u = closed_loop.time_response(plant, kp, Ti, target, reference)
    np.testing.assert_allclose(y, expected_y, rtol=0, atol=1e-6 * np.abs(expected_y).max())
    np.testing.assert_allclose(u, expected_u, rtol=0, atol=1e-6 * np.abs(expected_u).max())


def test_measures_of_small_steps_are_those_of_the_linear_loop():
    context = contexts(10, seed=1)
    kp, Ti = oracle(context)
    found = time_domain(TASK, context, kp, Ti, 1e-5)
    y, _ = closed_loop.time_response(loops(TASK, context).plant, kp, Ti, TASK.target, np.ones(1000))
    np.testing.assert_allclose(found.overshoot, 100 * np.maximum(y.max(axis=1) - 1, 0), atol=1e-3)
    for b in range(10):
        outside = np.flatnonzero(np.abs(y[b] - 1) > 0.02)
        expected = math.nan if outside[-1] == 999 else 0.01 * (outside[-1] + 1)
        assert found.settling_time[b] == pytest.approx(expected, nan_ok=True)


def test_tracking_worsens_with_the_demand_on_low_friction():
    context = Context.of([0.3, 1.0], 100.0, 20.0)
    kp, Ti = oracle(context)
    gentle, hard = (time_domain(TASK, context, kp, Ti, math.radians(r)) for r in (1.0, 20.0))
    growth = hard.tracking_error / (20 * gentle.tracking_error)
    assert growth[0] > 1.15  # 20 deg/s at 20 m/s would take 0.7 g
    assert growth[1] < 1.1


def test_one_loop_does_not_depend_on_the_batch():
    context = contexts(20, seed=2)
    kp, Ti = oracle(context)
    together = time_domain(TASK, context, kp, Ti)
    for i in (0, 7, 19):
        part = slice(i, i + 1)
        alone = time_domain(TASK, take(context, part), kp[part], Ti[part])
        for name in ("overshoot", "settling_time", "tracking_error"):
            np.testing.assert_array_equal(getattr(alone, name), getattr(together, name)[part])


def test_a_linear_twin_is_refused():
    context = contexts(2, seed=3)
    with pytest.raises(ValueError, match="task.twin"):
        time_domain(Task(), context, np.ones(2), np.ones(2))
