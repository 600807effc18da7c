"""Curves in an actuator: their answers in closed form, and what inputs of several levels show."""

import numpy as np
import pytest
from two_by_two import plant as two
from two_by_two import simulate as of_two

import tuners
from studies.process_recordings import FAULTS, recordings
from tuners.trust.actuator_curve import actuator_curves
from tuners.trust.basis import functions_for
from tuners.trust.black_box import black_box
from tuners.tuner.recording import Recording
from yawrate_env import plants
from yawrate_env.plant.episodes import recorded, sample

LEVELS = {"levels": 4}
FAULT = {fault.name: fault for fault in FAULTS}


def model_of(plant, u, y):
    return black_box(plant, functions_for(plant), u, y, "rest")


def test_a_linear_plants_answers_are_those_to_the_powers():
    plant = plants.fopdt(experiment={**LEVELS, "amplitude": 3.0})
    block = recorded(plant, "test", 0, 3)
    found = actuator_curves(plant, block.theta, model_of(plant, block.u, block.y))
    centred = plant.u - plant.u.mean()
    for power, answer in zip((2, 3), found.swapaxes(0, 1), strict=True):
        right = plant.respond(block.theta, centred**power)
        ratio = (answer * right).sum() / (right**2).sum()
        np.testing.assert_allclose(answer, ratio * right, atol=1e-9 * np.abs(answer).max())


def test_each_of_several_inputs_has_its_own():
    u = two.u * np.linspace(0.2, 1.0, two.samples)
    y = two.respond(two.middle, u)
    found = actuator_curves(two, two.middle, model_of(two, u[None], y))
    assert found.shape == (1, 4, 2 * two.samples)
    alone = (u[1] - u[1].mean()) ** 2
    right = of_two(two.middle[0], np.stack([0 * alone, alone]), None)
    turned = two.unstacked(found[:, 1])[0]  # squares of both inputs, then cubes
    ratio = (turned * right).sum() / (right**2).sum()
    np.testing.assert_allclose(turned, ratio * right, atol=1e-9 * np.abs(turned).max())


def test_two_levels_have_none():
    plant = plants.fopdt()
    block = recorded(plant, "test", 0, 2)
    assert actuator_curves(plant, block.theta, model_of(plant, block.u, block.y)) is None


@pytest.mark.parametrize("levels, trusted", [(2, 40), (4, 0)])
def test_four_levels_show_a_saturation_that_two_hide(levels, trusted):
    """40 recordings by SciPy in which the actuator gives 70 % of the largest command: all miss."""
    plant = plants.fopdt(experiment={"levels": levels})
    tuner, theta = tuners.load("gb", plant), sample(plant, 40)
    for name, expected in (("none", 40), ("saturation at 70 %", trusted)):
        u, y, Ts = recordings(plant, theta, FAULT[name], 3)
        gains, found = tuner.assess(Recording(u, y, Ts))
        error = plant.metric_values(theta, gains.values) - plant.metric_values(
            theta, plant.oracle(theta)
        )
        missed = (np.abs(error) > 2 * plant.metric_setting("error")).any(axis=1)
        assert missed.all() == (name != "none")
        assert abs(found.trusted.sum() - expected) <= 1
