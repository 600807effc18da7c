"""Linear plants in a PI loop, and the yaw-rate case through the same door as all others."""

import control
import numpy as np
import pytest

import tuners
from tuners import bound, plants
from tuners.feedforward import FeedForwardSettings
from tuners.identification import identify as native_identify
from tuners.laguerre import Laguerre
from tuners.plants.black_box import sample
from tuners.plants.bound import cramer_rao
from tuners.plants.data import episodes
from tuners.plants.evaluation import TUNER, compare
from tuners.plants.identification import identify
from tuners.plants.pi_loop import PILoop
from tuners.plants.yaw_rate import yaw_rate
from tuners.recording import Recording
from tuners.tuner import nominal_context
from yawrate_env.batch import concatenate
from yawrate_env.contexts import CONTEXT_SETS
from yawrate_env.excitation import prbs
from yawrate_env.judge import Judge
from yawrate_env.task import Experiment, Prior, Target, Task
from yawrate_env.vehicle import Context

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
    np.testing.assert_allclose(loop.judge(theta, gains), [[50.0, 1.0]] * 2, rtol=1e-9)
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


def context(theta):
    return Context.of(theta[:, 0], theta[:, 1], 20.0)


def test_the_yaw_rate_plant_is_the_environments(plant):
    theta = sample(plant, 6)
    oracle = Judge.of(TASK, context(theta)).oracle()
    np.testing.assert_array_equal(plant.oracle(theta), np.stack([oracle.kp, oracle.Ti], axis=1))
    gains = np.array([[0.2, 0.3], [0.4, 0.1], [0.1, 2.0], [2.0, 0.01], [-1.0, 1.0], [1e-4, 1.0]])
    verdict = Judge.of(TASK, context(theta))(*gains.T)
    np.testing.assert_allclose(plant.reward(theta, gains), verdict.reward, atol=1e-9)
    assert len(np.unique(verdict.reward.round(6))) >= 4  # graded, unstable and without crossover


def test_the_generic_gray_box_and_bound_are_the_native_ones(plant):
    draw = CONTEXT_SETS["test"].draw(TASK.prior, 0, 0, 12)
    theta = np.stack([draw.context.mu_s, draw.context.M_delta], axis=1)
    np.testing.assert_allclose(cramer_rao(plant, theta), bound.cramer_rao(TASK, draw), rtol=2e-3)
    y = plant.record(theta, draw.key, None)
    native = native_identify(
        TASK.vehicle, Recording(plant.u[None], y, TASK.experiment.Ts),
        nominal_context(TASK.prior), draw.context.v_x,
    )  # fmt: skip
    found = identify(plant, plant.u, y, theta, beyond=True)
    scale = [0.8, 300.0]
    known = np.stack([native.context.mu_s, native.context.M_delta], axis=1)
    inside = (known >= plant.search_limits[0]).all(axis=1)
    np.testing.assert_allclose(found.theta[inside] / scale, (known / scale)[inside], atol=1e-5)
    assert inside.sum() > 8


def test_the_generic_tuner_is_as_accurate_as_the_native_one(plant):
    recipe = tuners.Recipe(
        Laguerre(8, 12.0), FeedForwardSettings(neurons=10, epochs=150, max_fail=10), noise_draws=4
    )
    generic = plants.train(plant, recipe, count=400, calibration=0)
    native = tuners.train(recipe, TASK, episodes=400)
    block = concatenate([*episodes(plant, "test", 0, 0, 400)])
    design, _ = native.gains(Recording(plant.u[None], block.y, TASK.experiment.Ts))
    errors = plant.judged(block.theta, np.stack([design.kp, design.Ti], axis=1)) - [60.0, 1.5]
    own = compare(generic, 400, 0).rms(TUNER)
    # Two trainings on other vehicles and noise: 400 errors each give 5 %, the networks the rest.
    np.testing.assert_allclose(own, np.sqrt((errors**2).mean(axis=0)), rtol=0.35)


@pytest.mark.parametrize(
    "task", [Task(prior=Prior(v_x=(10, 33))), Task(experiment=Experiment(register="random"))]
)
def test_what_a_plant_cannot_have_is_refused(task):
    with pytest.raises(ValueError, match="one speed and one input"):
        yaw_rate(task)
