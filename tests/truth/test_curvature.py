"""Responses that bend, and starts that last too long: found where they are, and only there."""

import numpy as np
import pytest

from tuners.features.laguerre import Laguerre
from tuners.trust.black_box import black_box, decays
from tuners.trust.memory import lingering
from tuners.trust.response import Response
from yawrate_env.plant.episodes import recorded
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

PLANT = yaw_rate(Task())
FUNCTIONS, SURE = Laguerre(24, 16.0), 4.0
COUNT, N = 12, 8000
RNG = np.random.default_rng(5)
LEVELS = np.repeat(RNG.uniform(-0.03, 0.03, (1, N // 100)), 100, axis=1)
"""An input of many levels: two would hide its cube."""

BLOCK = recorded(PLANT, "test", 0, COUNT)


def response_of(u, y, start="rest"):
    noise = 0.02 * y.std() * np.random.default_rng(7).standard_normal(y.shape)
    return Response.of(black_box(PLANT, FUNCTIONS, u, y + noise, start), PLANT.loop_target)


def needed(u):
    """What the linear plants ask of a controller."""
    return response_of(u, PLANT.respond(BLOCK.theta, u)).required


def test_a_linear_plant_bends_no_more_often_than_chance():
    found = response_of(LEVELS, PLANT.respond(BLOCK.theta, LEVELS)).curvature
    assert (found.sizes < SURE).all()
    assert 0.3 < found.sizes[:, 0].std() and found.sizes.mean() < 1.5  # of a half normal: 0.8


def test_a_steering_ratio_that_grows_is_found_and_extrapolated_to_no_amplitude():
    growth = 0.2 * (LEVELS / LEVELS.std()) ** 2 / 3
    found = response_of(LEVELS, PLANT.respond(BLOCK.theta, LEVELS * (1 + growth)))
    assert (found.curvature.sizes[:, 0] > SURE).all()
    # The recording's response asks for lower gains; the shift is the way back.
    small = found.required + found.curvature.shifts[:, 0]
    exact = needed(LEVELS)
    assert np.abs(found.required - exact)[:, 0].min() > 0.1
    np.testing.assert_allclose(small, exact, atol=0.05)


def test_two_levels_of_an_input_say_nothing_of_its_cube():
    u = PLANT.u[None, :N]
    found = response_of(u, PLANT.respond(BLOCK.theta, u)).curvature
    assert (found.sizes[:, 0] == 0).all() and (found.shifts[:, 0] == 0).all()


def moving(y):
    u = PLANT.u[None, 2000:]
    model = black_box(PLANT, FUNCTIONS, u, y[:, 2000:], "unknown")
    return model, Response.of(model, PLANT.loop_target).lingering


def test_a_start_in_motion_is_forgotten_as_soon_as_the_plant_forgets():
    model, late = moving(BLOCK.y)
    assert (late < 0.01).all()
    assert np.median(np.abs(model.free).max(axis=1) / BLOCK.y.std(axis=1)) > 0.1
    rest = black_box(PLANT, FUNCTIONS, PLANT.u[None], BLOCK.y, "auto")
    assert (lingering(rest, rest.coefficients) == 0).all()


@pytest.mark.parametrize("number", [14, 20])
def test_what_the_plant_cannot_remember_is_no_start(number):
    """One of the last functions alone decays a second after the vehicles' responses."""
    decay = decays(FUNCTIONS, BLOCK.y.shape[1] - 2000, PLANT.Ts)[number]
    y = BLOCK.y.copy()
    y[:, 2000:] += BLOCK.y.std() * decay / np.abs(decay).max()
    assert (moving(y)[1] > 0.04).all()
