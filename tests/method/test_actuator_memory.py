"""Actuators that stick: what they do in closed form, and what the check finds in recordings."""

from copy import copy

import numpy as np
import pytest
from two_by_two import plant as two

import tuners
from studies.process_recordings import FAULTS, Fault, loose, recordings, returning, skipping
from tuners.trust.actuator_memory import positions, sticking
from tuners.trust.basis import functions_for
from tuners.trust.black_box import black_box
from tuners.trust.fit import fit
from tuners.tuner.recording import Recording
from yawrate_env import plants
from yawrate_env.plant.episodes import recorded, sample

FAULT = {fault.name: fault for fault in FAULTS}
EXPERIMENTS = {
    "2 levels": {},
    "4 levels": {"levels": 4},
    "multisine": {"kind": "multisine"},
}


def test_positions_follow_a_triangle_as_their_models_say():
    up = np.linspace(0.0, 1.0, 101)
    u = np.concatenate([up, up[-2::-1]])
    found = positions(u)
    # Dead band of half width 0.2: behind by 0.2 going up, ahead by 0.2 coming down.
    band = np.where(np.arange(len(u)) <= 100, np.maximum(u - 0.2, 0), np.minimum(0.8, u + 0.2))
    assert np.abs(found - band).max(axis=1).min() < 1e-12
    # Stuck at the turn alone, until the command is more than 0.3 away, and then where it is.
    held = np.where(u > 0.3 + 1e-9, u, 0.0)
    held[101:] = np.where(u[101:] >= 0.7 - 1e-9, 1.0, u[101:])
    assert np.sort(np.abs(found - held).max(axis=1))[0] < 0.011  # a step of the triangle
    assert not len(positions(np.ones(50)))


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_right_recordings_show_none(name):
    plant = plants.fopdt(experiment=EXPERIMENTS[name])
    tuner, theta = tuners.load("gb", plant), sample(plant, 100)
    u, y, Ts = recordings(plant, theta, FAULT["none"], 3)
    found = tuner.assess(Recording(u, y, Ts))[1].findings["sticking"]
    assert (found.values > 0).sum() <= 1


@pytest.mark.parametrize(
    "name, fault",
    [
        ("2 levels", FAULT["valve up to 7 s late"]),
        ("4 levels", FAULT["valve up to 7 s late"]),
        ("4 levels", Fault("dead band", valve=loose)),
        ("multisine", FAULT["valve with friction"]),
        ("multisine", Fault("He", valve=skipping)),
        ("multisine", Fault("Kano", valve=returning)),
    ],
)
def test_valves_that_stick_are_not_trusted_where_gains_miss(name, fault):
    """40 recordings by SciPy; those of He and Kano are no models of the check's."""
    plant = plants.fopdt(experiment=EXPERIMENTS[name])
    tuner, theta = tuners.load("gb", plant), sample(plant, 40)
    u, y, Ts = recordings(plant, theta, fault, 3)
    gains, found = tuner.assess(Recording(u, y, Ts))
    error = plant.metric_values(theta, gains.values) - plant.metric_values(
        theta, plant.oracle(theta)
    )
    missed = (~(np.abs(error) <= 2 * plant.metric_setting("error"))).any(axis=1)
    values = found.findings["sticking"].values
    assert missed.any() and (values[missed] > 0.5).mean() > 0.7
    assert (found.trusted & missed).sum() <= 2


def test_a_disturbance_of_any_colour_is_no_sticking():
    plant = plants.fopdt()
    tuner, theta, rng = tuners.load("gb", plant), sample(plant, 60), np.random.default_rng(1)
    u, y, Ts = recordings(plant, theta, FAULT["none"], 3)
    wave = np.cumsum(rng.standard_normal(y.shape), axis=1)
    wave *= 0.1 * y.std(axis=1, keepdims=True) / wave.std(axis=1, keepdims=True)
    found = tuner.assess(Recording(u, y + wave, Ts))[1].findings["sticking"]
    assert (found.values > 0.25).sum() <= 4


def test_each_of_several_inputs_has_its_own():
    block = recorded(two, "test", 0, 4)
    theta, u = block.theta, block.u
    v = u.copy()
    v[..., 1, :] = np.stack([positions(row)[2] for row in u[..., 1, :]])
    y = block.y + two.respond(theta, v) - two.respond(theta, u)
    model = black_box(two, functions_for(two), u, y, "rest")
    found = fit(two, model, y, np.tile(two.middle, (4, 1))).sticking
    assert found.shape == (4, 4, len(two.unknown))
    assert (np.abs(found).max(axis=2) > 0)[:, 2].all()


def test_nonlinear_plants_and_references_of_a_loop_are_not_searched():
    block = recorded(plants.fopdt(), "test", 0, 2)
    for changes, none in (({}, False), ({"linear": False}, True), ({"in_loop": True}, True)):
        plant = copy(plants.fopdt())
        for name, value in changes.items():
            object.__setattr__(plant, name, value)
        model = black_box(plants.fopdt(), functions_for(plants.fopdt()), block.u, block.y, "rest")
        silent = np.zeros((2, plant.samples))
        found = sticking(
            plant, block.theta, model, silent, silent[:, None], np.ones(2), np.ones((2, 1, 1))
        )
        assert found is None if none else not found.any()
