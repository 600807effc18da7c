"""Linear plants in a PI loop, against python-control, and the vehicle among them."""

from dataclasses import replace

import control
import numpy as np
import pytest

from yawrate_env.loop.target import Target
from yawrate_env.plant.episodes import Draw, integers_of, sample
from yawrate_env.plant.pi_loop import PILoop
from yawrate_env.signals.excitation import prbs
from yawrate_env.signals.streams import stream
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.single_track import context_of
from yawrate_env.vehicle.task import Experiment, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

TARGET = Target(phase_margin=50.0, crossover=1.0, Ts=0.02)
TASK = Task(experiment=Experiment(Ts=0.004, N=2500))


def model(theta):
    """An order of 3 in states with another output row for every plant."""
    gain, lag = theta
    A = np.array([[-1 / lag, 1.0, 0.0], [0.0, -8.0, 2.0], [0.5, 0.0, -20.0]])
    return control.ss(A, [[0.0], [1.0], [3.0]], [[gain, -0.2, gain]], 0.0)


def test_python_control_models_are_simulated_as_python_control_does():
    loop, theta = PILoop.of(model, 0.01, TARGET), np.array([[2.0, 0.5], [-3.0, 0.2]])
    u = prbs(400, 0.01, 0.2, 1.0)[0]
    for row, y in zip(theta, loop.simulate(theta, u, None), strict=True):
        expected = control.forced_response(model(row).sample(0.01), U=u).outputs
        np.testing.assert_allclose(y, expected, atol=1e-12 * np.abs(expected).max())


def test_the_design_meets_the_target_by_python_controls_own_margins():
    loop = PILoop.of(lambda theta: control.tf([theta[0]], [theta[1], 1]), 0.01, TARGET)
    theta = np.array([[2.0, 0.5], [3.0, 0.2]])
    gains, reached = loop.design(theta)
    metrics, stable = loop.evaluate(theta, gains)
    np.testing.assert_allclose(metrics, [[50.0, 1.0]] * 2, rtol=1e-9)
    assert reached.all() and stable.all()
    for (K, T), (kp, Ti) in zip(theta, gains, strict=True):
        plant = control.tf([K], [T, 1]).sample(0.02)
        pi = kp * (1 + 0.02 / (2 * Ti) * control.tf([1, 1], [1, -1], 0.02))
        _, pm, _, wc = control.margin(plant * pi)
        assert (pm, wc) == pytest.approx((50.0, 2 * np.pi), rel=1e-6)


def test_models_that_do_not_fit_are_refused():
    through = PILoop.of(lambda theta: control.tf([1, 1], [theta[0], 1]), 0.01, TARGET)
    with pytest.raises(ValueError, match="D = 0"):
        through.design(np.ones((1, 1)))


def test_the_vehicles_design_and_evaluation_are_those_of_its_loops():
    plant = yaw_rate(TASK)
    theta = sample(plant, 6)
    expected = loops(TASK, context_of(theta)).design()
    np.testing.assert_array_equal(plant.oracle(theta), np.stack([expected.kp, expected.Ti], axis=1))
    gains = np.array([[0.2, 0.3], [0.4, 0.1], [0.1, 2.0], [2.0, 0.01], [-1.0, 1.0], [1e-4, 1.0]])
    found = loops(TASK, context_of(theta)).evaluate(*gains.T)
    metrics, stable = plant.evaluation(theta, gains)
    np.testing.assert_array_equal(stable, found.stable)
    for i, name in enumerate(("phase_margin", "crossover", "gain_margin")):
        np.testing.assert_array_equal(metrics[:, i], getattr(found.margins, name))
    assert len(np.unique(plant.reward(theta, gains).round(6))) >= 4  # graded, unstable, undefined


def test_simulation_and_noise_in_one_call_are_the_same():
    plant = yaw_rate(TASK)
    draw = Draw.of(plant, stream(0, 0, 12, integers_of(plant)))
    fast, slow = (
        each.measure(draw.theta, draw.u, draw.keys) for each in (plant, replace(plant, record=None))
    )
    np.testing.assert_allclose(slow, fast, rtol=1e-12)
