"""Loop coordinates and gains: definition, round trips and what cannot be converted."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tuners.tuner.coordinates import COORDINATES, decode, encode
from yawrate_env.env.interaction import KP_RANGE, TI_RANGE
from yawrate_env.loop.controller import gains
from yawrate_env.loop.design import LEAST_LAG, Status
from yawrate_env.loop.target import CONTROLLERS, Target
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Task

exponents = [st.floats(*np.log10(bounds)) for bounds in (KP_RANGE, TI_RANGE)]


@given(kp=exponents[0], Ti=exponents[1], controller=st.sampled_from(CONTROLLERS))
@pytest.mark.parametrize("coordinates", COORDINATES)
def test_round_trip_over_the_action_box(coordinates, kp, Ti, controller):
    target = Target(controller=controller)
    kp, Ti = np.array([10**kp]), np.array([10**Ti])
    found = decode(encode(kp, Ti, target, coordinates), target, coordinates)
    # Near -90 degrees the tangent magnifies rounding by up to 1000.
    np.testing.assert_allclose([found.kp, found.Ti], [kp, Ti], rtol=1e-11)
    assert found.status[0] == Status.OK


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
    np.testing.assert_allclose(encode(kp, Ti, target, "loop"), expected, rtol=1e-12)


def test_gains_are_taken_literally():
    np.testing.assert_array_equal(
        encode(np.array([0.2, 3.0]), np.array([0.08, 5.0]), Target(), "gains"),
        [[0.2, 0.08], [3.0, 5.0]],
    )


@pytest.mark.parametrize("degrees", [-5.0, 3.0])
def test_a_phase_error_is_the_same_error_of_phase_margin_for_every_vehicle(degrees):
    task = Task()
    judge = loops(task, Context.of([0.4, 0.7, 1.0], [300.0, 150.0, 0.0], 20.0))
    best = judge.design()
    values = encode(best.kp, best.Ti, task.target, "loop") + [0.0, np.radians(degrees)]
    found = decode(values, task.target, "loop")
    margins = judge.evaluate(found.kp, found.Ti).margins
    np.testing.assert_allclose(margins.phase_margin, 60 + degrees, rtol=1e-9)
    np.testing.assert_allclose(margins.crossover, 1.5, rtol=1e-9)


@pytest.mark.parametrize("phase", [0.0, 1e-9, 0.5, 3.0])
def test_a_lead_is_clamped_to_the_least_lag(phase):
    found = decode(np.array([[-1.5, phase]]), Target(), "loop")
    assert found.status[0] == Status.PHASE_LIMITED
    expected = gains(np.array([-1.5]), np.array([-LEAST_LAG]), Target())
    np.testing.assert_array_equal([found.kp, found.Ti], expected)


@pytest.mark.parametrize(
    "values", [(-1.5, -np.pi / 2), (-1.5, -4.0), (np.nan, -1.0), (0.0, np.nan), (np.inf, -1.0)]
)
def test_what_no_pi_supplies_is_unreachable(values):
    found = decode(np.array([values, (-1.5, -0.5)]), Target(), "loop")
    assert found.status.tolist() == [Status.UNREACHABLE, Status.OK]
    assert np.isnan([found.kp[0], found.Ti[0]]).all()
    assert np.isfinite([found.kp[1], found.Ti[1]]).all()


@pytest.mark.parametrize("values", [(0.0, 1.0), (-0.1, 1.0), (0.1, -1.0), (np.nan, 1.0)])
def test_gains_that_are_not_positive_are_unreachable(values):
    found = decode(np.array([values, (0.2, 0.3)]), Target(), "gains")
    assert found.status.tolist() == [Status.UNREACHABLE, Status.OK]
    assert np.isnan([found.kp[0], found.Ti[0]]).all()
    assert (found.kp[1], found.Ti[1]) == (0.2, 0.3)


def test_unknown_coordinates_are_refused():
    one = np.ones(1)
    with pytest.raises(ValueError, match="coordinates = 'polar' .* loop, gains"):
        encode(one, one, Target(), "polar")
    with pytest.raises(ValueError, match="coordinates = 'polar' .* loop, gains"):
        decode(np.ones((1, 2)), Target(), "polar")


@pytest.mark.parametrize("log_gain", [-800.0, 800.0, np.inf, np.nan])
def test_gains_without_a_number_are_unreachable(log_gain):
    found = decode(np.array([[log_gain, -0.5]]), Target(), "loop")
    assert found.status[0] == Status.UNREACHABLE and np.isnan([found.kp[0], found.Ti[0]]).all()
