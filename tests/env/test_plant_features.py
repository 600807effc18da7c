"""Features and unit actions of any plant's environment, on one in closed form."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from first_order import TS, described, gauged, plant

from tuners.agents.feature_map import ActionMap
from tuners.agents.wrappers import FeatureObservation, UnitAction
from tuners.features.laguerre import Laguerre
from tuners.features.regularised import Regularised
from tuners.tuner.training import recipe_for
from yawrate_env import FEATURES_ID, PLANT_FEATURES_ID
from yawrate_env.env.tuning_env import plant_env
from yawrate_env.plant.episodes import recorded
from yawrate_env.plant.parametrisation import GAINS
from yawrate_env.signals.excitation import prbs
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

SHORT = {"Ts": 0.01, "N": 300}
TASK = Task(experiment=Experiment(**SHORT))


def actions(count, seed):
    """Somewhat more than the action box."""
    return np.random.default_rng(seed).uniform(-1.2, 1.2, (count, 2)).astype(np.float32)


# Features


def test_features_are_those_of_the_plants_own_recipe():
    found, seen = FeatureObservation(plant_env(gauged)).map, recorded(gauged, "test", 0, 20)
    stage = recipe_for(gauged).features
    expected, _ = stage(seen.u, seen.y, gauged.Ts)
    assert found.features == stage
    features, usable = found(seen.u, seen.y, gauged.Ts, gauged.measured_features(seen.theta))
    assert usable.all() and features.dtype == np.float32
    raw = features * found.scale + found.mean
    np.testing.assert_allclose(raw[:, :-1], expected, atol=1e-5)
    np.testing.assert_allclose(raw[:, -1], np.log(seen.theta[:, 0]), atol=1e-5)  # the measured K


def test_features_of_different_inputs_are_regularised_by_the_prior():
    various = described(excite=lambda n: prbs(500, TS, 0.5, 1.0, order=14, start=n))
    found = FeatureObservation(plant_env(various))
    assert isinstance(found.map.features, Regularised)
    found.reset(seed=3)
    assert found.observation_space.shape == (len(found.map.features.directions),)
    coarse = FeatureObservation(plant_env(various), order=6).map.features
    assert coarse == Laguerre(6, found.map.features.pole)


def test_features_are_standardised_over_the_prior():
    many = gymnasium.make_vec(PLANT_FEATURES_ID, num_envs=400, plant="first_order:gauged")
    obs, _ = many.reset(seed=0)
    # Means of 400 draws less means of 512: within 4.5 of their standard deviation, 0.067.
    np.testing.assert_allclose(obs.mean(axis=0), 0, atol=0.3)
    np.testing.assert_allclose(obs.std(axis=0), 1, atol=0.25)


def test_settings_that_are_not_given_are_the_plants():
    suited = recipe_for(plant).features
    found = FeatureObservation(plant_env(plant), order=6).map.features
    assert (found.order, found.pole) == (6, suited.pole) and suited.order != 6
    with pytest.raises(ValueError, match="features = 'fourier'"):
        gymnasium.make(PLANT_FEATURES_ID, plant=plant, features="fourier")


# Actions


@pytest.mark.parametrize("action", [[0.0], [np.nan, 0.0], [[0.0, 0.0]]])
def test_bad_actions_are_refused(action):
    env = UnitAction(plant_env(plant))
    env.reset(seed=0)
    with pytest.raises(ValueError, match="action"):
        env.step(np.array(action))


def test_the_vehicles_environment_is_that_of_their_plant():
    """To the last bit: what is seen of every episode, and what is done in it."""
    theirs = gymnasium.make(FEATURES_ID, **SHORT)
    ours = UnitAction(FeatureObservation(plant_env(yaw_rate(TASK)), order=10, pole=12.0))
    assert ours.observation_space == theirs.observation_space
    for seed in range(5):
        np.testing.assert_array_equal(ours.reset(seed=seed)[0], theirs.reset(seed=seed)[0])
        action = actions(1, seed)[0]
        (_, reward, *_, mine), (_, expected, *_, info) = ours.step(action), theirs.step(action)
        assert (mine["kp"], mine["Ti"]) == (info["kp"], info["Ti"])
        assert reward == pytest.approx(expected, rel=1e-12)


# Bounds of the actions

LOOP = replace(yaw_rate(Task(prior=Prior(v_x=(10.0, 33.0)))), action_bounds=None)
BOUNDED = {
    "logarithms": plant,
    "gains": described(parametrisation=GAINS),
    "loop": LOOP,
    "vehicles": yaw_rate(TASK),
}


@pytest.mark.parametrize("name", BOUNDED)
def test_the_oracle_is_within_the_bounds_with_room_to_spare(name):
    of = BOUNDED[name]
    gains = of.oracle(recorded(of, "test", 0, 128).theta)
    gains = gains[np.isfinite(gains).all(axis=1)]
    known = ActionMap.of(of)
    used = known.actions(gains)
    assert np.abs(used).max() < 1 and np.ptp(used, axis=0).min() > 0.4
    np.testing.assert_allclose(known.gains(used), gains, rtol=1e-9)


@pytest.mark.parametrize("name", BOUNDED)
def test_all_actions_within_the_bounds_are_gains_that_the_environment_takes(name):
    of = BOUNDED[name]
    known, box = ActionMap.of(of), plant_env(of).action_space
    units = np.random.default_rng(0).uniform(-1, 1, (200, 2)).round()  # corners, edges, middle
    gains = known.gains(units)
    assert (gains > 0).all() and (gains >= box.low).all() and (gains <= box.high).all()
    np.testing.assert_allclose(known.actions(gains), units, atol=1e-6)


def test_a_plant_may_have_its_own_bounds():
    own = described(action_bounds=lambda: ([-1.0, -2.0], [1.0, 0.5]))
    np.testing.assert_allclose(ActionMap.of(own).gains(np.ones((1, 2))), np.exp([[1.0, 0.5]]))


@pytest.mark.parametrize(
    "bounds", [lambda: [[0.0, 1.0], [1.0, 1.0]], lambda: np.ones(2), lambda: 1 / 0, 1.0]
)
def test_wrong_bounds_are_named(bounds):
    with pytest.raises(ValueError, match="action_bounds"):
        ActionMap.of(described(action_bounds=bounds))
