"""Linear plants in a PI loop, and the yaw-rate case through the same door as all others."""

from dataclasses import replace

import control
import numpy as np
import pytest

import tuners
from tuners import plants
from tuners.features.laguerre import Laguerre
from tuners.learners.feedforward import FeedForwardSettings
from tuners.trust import vehicle_bound as bound
from tuners.trust.black_box import black_box, functions_for
from tuners.trust.bound import cramer_rao
from tuners.trust.fit import fit
from tuners.tuner.recording import Recording
from yawrate_env.loop.target import Target
from yawrate_env.plant.episodes import recorded, sample
from yawrate_env.plant.pi_loop import PILoop
from yawrate_env.signals.excitation import prbs
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.episode import loops, record
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import context_of, theta_of, yaw_rate

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
    gains = loop.design(theta)
    np.testing.assert_allclose(loop.judge.evaluate(theta, gains), [[50.0, 1.0]] * 2, rtol=1e-9)
    for (K, T), (kp, Ti) in zip(theta, gains, strict=True):
        plant = control.tf([K], [T, 1]).sample(0.02)
        pi = kp * (1 + 0.02 / (2 * Ti) * control.tf([1, 1], [1, -1], 0.02))
        _, pm, _, wc = control.margin(plant * pi)
        assert (pm, wc) == pytest.approx((50.0, 2 * np.pi), rel=1e-6)


def test_models_that_do_not_fit_are_refused():
    through = PILoop.of(lambda theta: control.tf([1, 1], [theta[0], 1]), 0.01, TARGET)
    with pytest.raises(ValueError, match="D = 0"):
        through.design(np.ones((1, 1)))


@pytest.fixture(scope="module")
def plant():
    return yaw_rate(TASK)


def test_the_yaw_rate_plant_is_the_environments(plant):
    theta = sample(plant, 6)
    oracle = loops(TASK, context_of(theta)).design()
    np.testing.assert_array_equal(plant.oracle(theta), np.stack([oracle.kp, oracle.Ti], axis=1))
    gains = np.array([[0.2, 0.3], [0.4, 0.1], [0.1, 2.0], [2.0, 0.01], [-1.0, 1.0], [1e-4, 1.0]])
    verdict = loops(TASK, context_of(theta)).evaluate(*gains.T)
    np.testing.assert_allclose(plant.reward(theta, gains), verdict.reward, atol=1e-9)
    assert len(np.unique(verdict.reward.round(6))) >= 4  # graded, unstable and without crossover


@pytest.mark.parametrize("register", ["same", "random"])
def test_its_episodes_are_the_environments(register):
    task = Task(prior=Prior(v_x=(10.0, 33.0)), experiment=Experiment(0.004, 500, register=register))
    draw = CONTEXT_SETS["test"].draw(task.prior, 5, 0, 200)
    u, y = record(task, draw)
    found = recorded(yaw_rate(task), "test", 5, 200)
    np.testing.assert_array_equal(found.theta, theta_of(draw.context))
    np.testing.assert_array_equal(found.u, u)
    np.testing.assert_array_equal(found.y, y)


def test_it_has_no_private_way_to_record_or_to_search(plant):
    draw = CONTEXT_SETS["test"].draw(TASK.prior, 0, 0, 12)
    theta = theta_of(draw.context)
    slow = replace(plant, record=None, search=None, search_limits={})
    y = plant.measure(theta, plant.u[None], draw.key)
    np.testing.assert_allclose(slow.measure(theta, plant.u[None], draw.key), y, rtol=1e-12)
    model = black_box(plant, functions_for(plant), plant.u[None], y, "auto")
    start = np.repeat(plant.middle, 12, axis=0)
    native, found = (fit(p, model, y, start) for p in (plant, slow))
    inside = (np.abs(native.theta - plant.middle) <= (slow.limits[1] - plant.middle)).all(axis=1)
    assert inside.sum() > 8 and found.converged[inside].all()
    difference = (found.theta - native.theta)[:, :2] / plant.width
    np.testing.assert_allclose(difference[inside], 0.0, atol=1e-5)
    np.testing.assert_allclose(found.noise[inside], native.noise[inside], rtol=1e-8)


def test_the_generic_bound_is_the_native_one(plant):
    draw = CONTEXT_SETS["test"].draw(TASK.prior, 0, 0, 12)
    found = cramer_rao(plant, theta_of(draw.context))
    np.testing.assert_allclose(found, bound.cramer_rao(TASK, draw), rtol=2e-3)


@pytest.mark.parametrize(
    "task",
    [
        TASK,
        replace(TASK, prior=Prior(v_x=(10.0, 33.0))),
        replace(TASK, experiment=replace(TASK.experiment, register="random")),
    ],
)
def test_a_vehicles_tuner_is_its_plants_tuner(task):
    settings = FeedForwardSettings(neurons=6, epochs=40)
    recipe = tuners.Recipe(Laguerre(8, 12.0), settings, noise_draws=2)
    own, plant = tuners.train(recipe, task, episodes=150), yaw_rate(task)
    generic = plants.train(plant, recipe, count=150, calibration=0)
    block = recorded(plant, "test", 0, 30)
    recording = Recording(block.u, block.y, task.experiment.Ts, block.theta[:, 2])
    design, found = own.assess(recording)
    gains, same = generic.assess(block.u, block.y, block.theta)
    np.testing.assert_array_equal(np.stack([design.kp, design.Ti], axis=1), gains)
    np.testing.assert_array_equal(found.trusted, same.trusted)
    np.testing.assert_array_equal(found.metrics, same.metrics)
    np.testing.assert_array_equal(found.spread, same.spread)
    assert {"v_x", *found.findings} == {"speed", "implausible", *same.findings}
