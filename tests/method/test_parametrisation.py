"""Coordinates of gains: definition, round trips and what cannot be converted."""

import numpy as np
import pytest

from tuners.tuner.method import Gains
from yawrate_env.loop.controller import gains
from yawrate_env.loop.design import LEAST_LAG, Status
from yawrate_env.loop.target import CONTROLLERS, Target
from yawrate_env.plant.parametrisation import GAINS, LOG, loop
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

KINDS = {"gains": lambda target: GAINS, "log": lambda target: LOG, "loop": loop}


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("kind", KINDS)
def test_round_trip_over_the_action_box(kind, controller):
    coordinates = KINDS[kind](Target(controller=controller))
    kp, Ti = np.meshgrid(np.logspace(-3, 1, 41), np.logspace(-3, 2, 51))
    pairs = np.stack([kp.ravel(), Ti.ravel()], axis=1)
    # Near -90 degrees the tangent magnifies rounding by up to 1000.
    np.testing.assert_allclose(coordinates.decode(coordinates.encode(pairs)), pairs, rtol=1e-11)


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_loop_coordinates_are_the_controllers_response(controller):
    target = Target(controller=controller, crossover=2.0)
    kp, Ti, Ts = np.array([0.2, 3.0]), np.array([0.08, 5.0]), target.Ts
    z = np.exp(2j * np.pi * 2.0 * Ts)
    if controller == "pi":
        C = kp * (1 + Ts / (2 * Ti) * (z + 1) / (z - 1))
    else:
        C = kp / (1 + Ti * 2 / Ts * (z - 1) / (z + 1))
    expected = np.stack([np.log(abs(C)), np.angle(C)], axis=1)
    found = loop(target).encode(np.stack([kp, Ti], axis=1))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("degrees", [-5.0, 3.0])
def test_a_phase_error_is_the_same_error_of_phase_margin_for_every_plant(degrees):
    plant = yaw_rate(Task())
    theta = np.array([[0.4, 300.0, 20.0], [0.7, 150.0, 20.0], [1.0, 0.0, 20.0]])
    coordinates = plant.parametrisation
    values = coordinates.encode(plant.oracle(theta)) + [0.0, np.radians(degrees)]
    found = plant.metric_values(theta, coordinates.decode(values))
    np.testing.assert_allclose(found, np.tile([60 + degrees, 1.5], (3, 1)), rtol=1e-9)


@pytest.mark.parametrize("phase", [0.0, 1e-9, 0.5, 3.0])
def test_a_lead_is_clamped_to_the_least_lag(phase):
    found = loop(Target()).decode(np.array([[-1.5, phase]]))
    expected = gains(np.array([-1.5]), np.array([-LEAST_LAG]), Target())
    np.testing.assert_array_equal(found, np.transpose(expected))


NONE = [(-1.5, -np.pi / 2), (-1.5, -4.0), (np.nan, -1.0), (0.0, np.nan), (np.inf, -1.0)]
NONE += [(-800.0, -0.5), (800.0, -0.5)]


@pytest.mark.parametrize("values", NONE)
def test_what_no_pi_supplies_gives_no_gains(values):
    found = loop(Target()).decode(np.array([values, (-1.5, -0.5)]))
    assert np.isnan(found[0]).all() and np.isfinite(found[1]).all()


@pytest.mark.parametrize("values", [(0.0, 1.0), (-0.1, 1.0), (0.1, -1.0), (np.nan, 1.0)])
def test_gains_that_are_not_positive_are_none(values):
    found = GAINS.decode(np.array([values, (0.2, 0.3)]))
    assert np.isnan(found[0]).all() and found[1].tolist() == [0.2, 0.3]
    assert np.isnan(LOG.encode(np.array([values]))).any()


def test_logarithms_beyond_all_numbers_give_no_gains_and_no_warning():
    found = LOG.decode(np.array([[800.0, 0.0], [-800.0, 0.0], [np.nan, 0.0], [0.0, 0.0]]))
    assert np.isnan(found[:3]).all() and found[3].tolist() == [1.0, 1.0]


def test_the_status_of_gains_says_how_far_the_target_is_reached():
    values = np.array([[1.0, 2.0], [1.0, 2.0], [np.nan, 2.0]])
    found = Gains.of(values, np.array([True, False, False]), np.ones(3, bool))
    assert found.status.tolist() == [Status.OK, Status.PHASE_LIMITED, Status.UNREACHABLE]
    assert np.isnan(found.values[2]).all()
    less = found.without(np.array([True, False, False]))
    assert np.isnan(less.values[0]).all() and less.status[0] == Status.UNREACHABLE
    assert less.converged.tolist() == [False, True, True]
