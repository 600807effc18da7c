"""``yawrate/Plant-v0`` for a plant in closed form."""

import gymnasium
import numpy as np
import pytest
from first_order import U, described, gauged, plant, simulate

from yawrate_env import PLANT_ID
from yawrate_env.env.interface import action_box
from yawrate_env.env.tuning_env import plant_env
from yawrate_env.env.vector_env import plant_vector_env
from yawrate_env.plant.metric import Metric
from yawrate_env.plant.parametrisation import Parametrisation


def test_the_observation_is_the_recording_of_the_plant():
    env = plant_env(gauged)
    obs, _ = env.reset(seed=0, options={"K": 1.5, "T": 0.4})
    clean = plant.respond(np.array([[1.5, 0.4]]))[0]
    assert obs.shape == env.observation_space.shape == (3, len(U))
    np.testing.assert_allclose(obs[0], U)
    assert np.std(obs[1] - clean) == pytest.approx(plant.noise, rel=0.1)
    np.testing.assert_array_equal(obs[2], np.float32(1.5))
    *_, info = env.step(np.array([1e3, 1e3]))
    assert (info["K"], info["T"], info["clipped"]) == (1.5, 0.4, True)
    assert info["kp"] == env.action_space.high[0]
    assert info["oracle_kp"] == pytest.approx(0.4 / (1.5 * 0.3))


def test_observations_are_read_back_as_the_recordings_that_they_hold():
    interface = plant_env(gauged).interface
    obs, _ = plant_vector_env(3, plant=gauged).reset(seed=0)
    u, y, theta = interface.recordings(obs)
    assert u.shape == (1, len(U)) and y.dtype == np.float64
    np.testing.assert_array_equal(interface.observe(u, y, theta), obs)
    assert (theta[:, 1] == gauged.middle[0, 1]).all()  # not visible
    with pytest.raises(ValueError, match="obs has shape"):
        interface.recordings(obs[:, :2])


def test_actions_reach_what_the_prior_needs_and_no_constant_is_a_point():
    space = action_box(plant)
    corners = plant.oracle(np.array([[0.5, 1.0], [2.0, 0.2]]))
    assert (space.low < corners).all() and (corners < space.high).all()
    assert (space.low > 0).all()

    def constant(theta):
        return np.tile([-1.0, 2.0], (len(theta), 1))

    same = Parametrisation(lambda gains: gains, lambda values: values)
    fixed = action_box(described(design=constant, parametrisation=same))
    assert (fixed.low < [-1.0, 2.0]).all() and (fixed.high > [-1.0, 2.0]).all()


def margins(theta, gains):
    """The loop k K/(T s) with k = kp T/Ti is stable below 4; no metric below 0.3."""
    k = gains[:, 0] * theta[:, 0] * theta[:, 1] / gains[:, 1]
    values = np.stack([k, -k], axis=1)
    return np.where(k[:, None] < 0.3, np.nan, values), k < 4


def test_metrics_lose_their_units_and_are_no_numbers_where_the_loop_is_unstable():
    metrics = {"speed [rad/s]": Metric(0.5), "damping [dB]": Metric(np.inf)}
    env = plant_env(described(evaluate=margins, metrics=metrics, target=(1.0,)))
    found = {}
    for kp, Ti in ((1.0, 1.0), (3.9, 0.2), (0.3, 1.9)):
        env.reset(seed=0, options={"K": 1.0, "T": 1.0})
        env.action_space.low[:], env.action_space.high[:] = 0.01, 10.0
        _, reward, _, _, info = env.step(np.array([kp, Ti]))
        found[kp] = info["speed"], info["damping"], info["stable"], reward
    assert found[1.0] == (1.0, -1.0, True, 0.0)
    np.testing.assert_equal(found[3.9], (np.nan, np.nan, False, -5.0))
    assert found[0.3] == (np.inf, np.inf, True, -4.0)


def test_what_is_random_in_the_simulator_comes_from_the_seed():
    def noisy(theta, u, rng):
        clean = simulate(theta, u, None)
        return clean if rng is None else clean + rng.normal(size=clean.shape)

    env = plant_env(described(simulate=noisy, noise=0.0))
    first, second = env.reset(seed=3)[0], env.reset()[0]
    again = plant_env(described(simulate=noisy, noise=0.0))
    np.testing.assert_array_equal(again.reset(seed=3)[0], first)
    np.testing.assert_array_equal(again.reset()[0], second)


def test_outputs_that_are_not_finite_are_refused_with_the_plants_parameters():
    def unstable(theta, u, rng):
        return np.where(theta[:, :1] > 1.9, np.inf, simulate(theta, u, rng))

    env = plant_env(described(simulate=unstable))
    env.reset(seed=0, options={"K": 1.0})
    with pytest.raises(ValueError, match="K = 1.95, T = .* not finite"):
        env.reset(options={"K": 1.95})


def test_entries_without_a_plant_are_refused():
    for entry in ("gone:plant", "first_order:design", 3):
        with pytest.raises(ValueError, match="first_order|gone|entry"):
            gymnasium.make(PLANT_ID, plant=entry)
