"""Features, unit actions and trained agents for any plant, on one in closed form."""

import warnings
from dataclasses import replace
from functools import cache
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from first_order import described, gauged, lone, plant
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as sb3_check_env
from test_imports import modules_after

from tuners import plants
from tuners.agents import training as rl_training
from tuners.agents.feature_map import ActionMap
from tuners.agents.rl_tuner import ALGORITHMS, Training
from tuners.agents.wrappers import Compressed, LoopAction
from tuners.features.laguerre import Laguerre
from tuners.features.regularised import Regularised
from tuners.learners.actor import Agent
from tuners.tuner.training import recipe_for
from yawrate_env import FEATURES_ID, PLANT_FEATURES_ID, PLANT_ID
from yawrate_env.env.plant_env import PlantEnv
from yawrate_env.plant.episodes import recorded
from yawrate_env.plant.parametrisation import PLAIN
from yawrate_env.signals.excitation import prbs
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

PLANTS = {"plain": "first_order:plant", "measured": "first_order:gauged"}
SHORT = {"Ts": 0.01, "N": 300}
TASK = Task(experiment=Experiment(**SHORT))


def scalar(of="plain", **kwargs):
    return gymnasium.make(PLANT_FEATURES_ID, plant=PLANTS[of], **kwargs)


def batch(count, of="plain", **kwargs):
    return gymnasium.make_vec(PLANT_FEATURES_ID, num_envs=count, plant=PLANTS[of], **kwargs)


def actions(count, seed):
    """Somewhat more than the action box."""
    return np.random.default_rng(seed).uniform(-1.2, 1.2, (count, 2)).astype(np.float32)


# --- the environment of features


@pytest.mark.parametrize("of", PLANTS)
def test_the_checkers_mind_the_wrappers_only(of):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        sb3_check_env(scalar(of))
        assert not caught
        check_env(scalar(of), skip_render_check=True)
    messages = [str(warning.message) for warning in caught]
    # Gymnasium's prefers bare environments, and this one is made of wrappers.
    assert len(messages) == 1 and "different from the unwrapped version" in messages[0], messages


@pytest.mark.parametrize("of", PLANTS)
def test_each_row_of_the_batch_is_a_scalar_environment(of):
    many, ones = batch(3, of), [scalar(of) for _ in range(3)]
    assert many.single_observation_space == ones[0].observation_space
    assert many.single_action_space == ones[0].action_space
    obs, _ = many.reset(seed=5)
    np.testing.assert_allclose(obs, [e.reset(seed=5 + i)[0] for i, e in enumerate(ones)], atol=1e-5)
    for k in range(2):
        before = obs
        obs, rewards, terminated, _, info = many.step(actions(3, k))
        results = [one.step(a) for one, a in zip(ones, actions(3, k), strict=True)]
        np.testing.assert_allclose(rewards, [reward for _, reward, *_ in results], rtol=1e-12)
        assert terminated.all()
        np.testing.assert_array_equal(np.stack(info["final_obs"]), before)
        np.testing.assert_allclose(obs, [one.reset()[0] for one in ones], atol=1e-5)


def test_features_are_those_of_the_plants_own_recipe():
    found, seen = Compressed(PlantEnv(gauged)).map, recorded(gauged, "test", 0, 20)
    first_stage = recipe_for(gauged).compressor
    expected, _ = first_stage(seen.u, seen.y, gauged.Ts)
    assert found.compressor == first_stage
    features, usable = found(seen.u, seen.y, gauged.Ts, gauged.measured_features(seen.theta))
    assert usable.all() and features.dtype == np.float32
    raw = features * found.scale + found.mean
    np.testing.assert_allclose(raw[:, :-1], expected, atol=1e-5)
    np.testing.assert_allclose(raw[:, -1], np.log(seen.theta[:, 0]), atol=1e-5)  # the measured K


def test_inputs_of_their_own_have_features_that_the_prior_holds_together():
    def registers(words):
        return prbs(500, plant.Ts, 0.5, 1.0, order=14, start=words)

    various = described(excite=registers)
    found = Compressed(PlantEnv(various))
    assert isinstance(found.map.compressor, Regularised)
    found.reset(seed=3)
    assert found.observation_space.shape == (len(found.map.compressor.directions),)
    coarse = Compressed(PlantEnv(various), order=6).map.compressor
    assert coarse == Laguerre(6, found.map.compressor.pole)


def test_features_are_standardised_over_the_prior():
    obs, _ = batch(400, "measured").reset(seed=0)
    # Means of 400 draws less means of 512: within 4.5 of their standard deviation, 0.067.
    np.testing.assert_allclose(obs.mean(axis=0), 0, atol=0.3)
    np.testing.assert_allclose(obs.std(axis=0), 1, atol=0.25)


def test_specs_survive_json():
    env = scalar("measured", compressor="armax")
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    np.testing.assert_array_equal(env.reset(seed=2)[0], again.reset(seed=2)[0])
    assert env.step(actions(1, 0)[0])[1] == again.step(actions(1, 0)[0])[1]


def test_compressors_settings_are_the_plants_where_none_are_given():
    suited = recipe_for(plant).compressor
    found = Compressed(gymnasium.make(PLANT_ID, plant=plant), order=6).map.compressor
    assert (found.order, found.pole) == (6, suited.pole) and suited.order != 6
    with pytest.raises(ValueError, match="compressor = 'fourier'"):
        scalar(compressor="fourier")


@pytest.mark.parametrize("action", [[0.0], [np.nan, 0.0], [[0.0, 0.0]]])
def test_bad_actions_are_refused(action):
    env = LoopAction(PlantEnv(plant))
    env.reset(seed=0)
    with pytest.raises(ValueError, match="action has"):
        env.step(np.array(action))


def test_the_vehicles_environment_is_that_of_their_plant():
    """To the last bit: what is seen of every episode, and what is done in it."""
    theirs = gymnasium.make(FEATURES_ID, **SHORT)
    ours = LoopAction(Compressed(PlantEnv(yaw_rate(TASK)), order=10, pole=12.0))
    assert ours.observation_space == theirs.observation_space
    for seed in range(5):
        np.testing.assert_array_equal(ours.reset(seed=seed)[0], theirs.reset(seed=seed)[0])
        action = actions(1, seed)[0]
        (_, reward, *_, mine), (_, expected, *_, info) = ours.step(action), theirs.step(action)
        assert (mine["kp"], mine["Ti"]) == (info["kp"], info["Ti"])
        assert reward == pytest.approx(expected, rel=1e-12)


# --- what is within reach

LOOP = replace(yaw_rate(Task(prior=Prior(v_x=(10.0, 33.0)))), action_bounds=None)
REACHED = {
    "logarithms": plant,
    "gains": described(parametrisation=PLAIN),
    "loop": LOOP,
    "vehicles": yaw_rate(TASK),
}


@pytest.mark.parametrize("name", REACHED)
def test_the_oracle_is_within_reach_with_room_to_spare(name):
    described = REACHED[name]
    gains = described.oracle(recorded(described, "test", 0, 128).theta)
    gains = gains[np.isfinite(gains).all(axis=1)]
    known = ActionMap.of(described)
    used = known.actions(gains)
    assert np.abs(used).max() < 1 and np.ptp(used, axis=0).min() > 0.4
    np.testing.assert_allclose(known.gains(used), gains, rtol=1e-9)


@pytest.mark.parametrize("name", REACHED)
def test_all_that_is_within_reach_are_gains_that_the_environment_takes(name):
    described = REACHED[name]
    known, box = ActionMap.of(described), PlantEnv(described).action_space
    units = np.random.default_rng(0).uniform(-1, 1, (200, 2)).round()  # corners, edges, middle
    gains = known.gains(units)
    assert (gains > 0).all() and (gains >= box.low).all() and (gains <= box.high).all()
    np.testing.assert_allclose(known.actions(gains), units, atol=1e-6)


def test_a_plant_may_say_what_is_within_reach():
    own = described(action_bounds=lambda: ([-1.0, -2.0], [1.0, 0.5]))
    np.testing.assert_allclose(ActionMap.of(own).gains(np.ones((1, 2))), np.exp([[1.0, 0.5]]))


@pytest.mark.parametrize(
    "reach, words",
    [
        (lambda: [[0.0, 1.0], [1.0, 1.0]], "give the lowest, then the highest"),
        (lambda: np.ones(2), "reach has shape"),
        (lambda: 1 / 0, "reach failed: ZeroDivisionError"),
    ],
)
def test_a_wrong_reach_is_named(reach, words):
    with pytest.raises(ValueError, match=words):
        ActionMap.of(described(action_bounds=reach))
    with pytest.raises(ValueError, match="reach"):
        described(action_bounds=1.0)


# --- agents

EPISODES = 544  # SAC and TD3 start to learn after 512


def trained(
    of=plant, algorithm="sac", episodes=EPISODES, seed=0, num_envs=16, calibration=64, **others
):
    settings = Training(algorithm, episodes=episodes, num_envs=num_envs, seed=seed)
    return rl_training.train_plant(of, settings, calibration=calibration, **others)


@cache
def agent():
    return trained(lone, episodes=800, num_envs=4)  # the fewer, the sooner it starts to learn


def assert_same(a, b):
    for name, array in a.stages.learner.arrays().items():
        np.testing.assert_array_equal(array, b.stages.learner.arrays()[name])


def reward_of(tuner, count=128):
    seen = recorded(tuner.plant, "test", 0, count)
    return tuner.plant.reward(seen.theta, tuner.gains(seen.u, seen.y, seen.theta)).mean()


def test_an_agent_learns():
    seen = recorded(lone, "test", 0, 128)
    nominal = lone.reward(seen.theta, lone.oracle(lone.middle).repeat(128, axis=0)).mean()
    start = trained(lone, episodes=16, calibration=0)
    assert earned(agent()) > 0.6 * nominal > earned(start)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_every_algorithm_trains_a_plants_tuner(algorithm):
    calls = []
    found = trained("first_order:gauged", algorithm, calibration=0,
                    progress=lambda what, done, of: calls.append((what, done, of)))  # fmt: skip
    assert isinstance(found, plants.PlantTuner) and isinstance(found.stages.learner, Agent)
    assert found.training["name"] == "rl" and found.training["algorithm"] == algorithm
    assert calls[-1] == ("training rl", EPISODES, EPISODES)
    u, y = plant.u, plant.respond(np.array([[1.2, 0.5]]))[0]
    one, other = (found.tune(u, y, measured={"K": K}).gains for K in (1.2, 0.6))
    assert one != other  # what is measured is a feature


def test_a_seed_gives_the_same_agent_again():
    one, again, other = (trained(seed=s, calibration=0) for s in (0, 0, 1))
    assert_same(one, again)
    with pytest.raises(AssertionError):
        assert_same(one, other)


@pytest.mark.slow
def test_rewards_are_gone_for_where_the_design_rule_has_none():
    wanted = replace(lone, target=(0.3,))  # gains 30 % above those that it knows
    seen = recorded(wanted, "test", 0, 128)
    rule = wanted.reward(seen.theta, wanted.oracle(seen.theta))
    np.testing.assert_allclose(rule, -1 / (1 + 1 / 4))
    found = trained(wanted, episodes=800, num_envs=4, calibration=0)
    assert earned(found) > 0.7 * rule.mean()


def test_training_never_reads_the_design_rules_gains():
    blind = False

    def design(theta):
        return np.full((len(theta), 2), np.nan) if blind else plant.design(theta)

    judged = described(
        design=design,
        evaluate=lambda theta, gains: gains / plant.design(theta) - 1,
        metrics={"error of kp": 0.3, "error of Ti": 0.3},
        target=(0.0, 0.0),
    )
    run = rl_training.of_plant(judged, Training(episodes=EPISODES), None, None)
    (*_, (_, seeing)) = run.learn((), None)
    run = rl_training.of_plant(judged, Training(episodes=EPISODES), None, None)
    blind = True  # the range of the actions is all that the agent got of it
    (*_, (_, found)) = run.learn((), None)
    assert_same(seeing, found)


def test_saving_keeps_everything(tmp_path):
    agent().save(tmp_path / "rl.tuner")
    again = plants.load(tmp_path / "rl.tuner")
    assert_same(agent(), again)
    assert again.training == agent().training and again.calibration == agent().calibration
    y = lone.respond(np.array([[1.2, 0.5]]))[0] + 0.02 * np.random.default_rng(0).normal(size=500)
    one, other = (t.tune(lone.u, y) for t in (agent(), again))
    assert (one.gains, one.metrics, one.checks) == (other.gains, other.metrics, other.checks)


def test_using_it_needs_what_trained_it_no_more(tmp_path):
    agent().save(tmp_path / "rl.tuner")
    loaded = modules_after(
        "import sys; sys.path.insert(0, 'tests'); from tuners import plants; "
        f"t = plants.load({str(tmp_path / 'rl.tuner')!r}); t.tune(t.plant.u, t.plant.u)"
    )
    assert not loaded & {"torch", "stable_baselines3", "sb3_contrib", "xgboost", "cloudpickle"}


def test_answers_come_with_trust_and_calibrated_intervals():
    seen = recorded(lone, "test", 1, 200)
    gains, found = agent().assess(seen.u, seen.y, seen.theta)
    off = np.abs(lone.metric_values(seen.theta, gains) - found.metrics)
    held = off <= np.array(agent().calibration) * found.spread
    # 90 % intervals from 64 episodes: 0.9 within 3.5 standard deviations of both samples.
    assert (held.mean(axis=0) > 0.75).all()
    missed = np.abs(lone.errors(seen.theta, gains)) / lone.metric_setting("error")
    assert found.trusted.any()
    assert missed[found.trusted].max() < 1.5 < missed[~found.trusted].max()


def test_it_acts_in_both_environments_alike():
    raw = gymnasium.make(PLANT_ID, plant=lone)
    features = gymnasium.make(PLANT_FEATURES_ID, plant=lone)
    learner = agent().stages.learner
    for seed in range(3):
        action, _ = agent().predict(raw.reset(seed=seed)[0])
        own = learner.actor(features.reset(seed=seed)[0][None])[0]
        a, b = raw.step(action)[4], features.step(own.astype(np.float32))[4]
        assert a["kp"] == pytest.approx(b["kp"], rel=1e-5) and not a["clipped"]


class Interrupted(Exception):
    pass


def test_a_resumed_training_goes_on_where_it_was(tmp_path):
    checkpoint = tmp_path / "agent.zip"

    def stop(what, done, of):
        if done > 580:
            raise Interrupted

    with pytest.raises(Interrupted):
        trained(episodes=640, checkpoint=checkpoint, progress=stop)
    run = rl_training.of_plant(plant, Training(episodes=640), None, checkpoint)
    assert run.model.num_timesteps == 576 and run.average.batches == 36
    found = trained(episodes=640, checkpoint=checkpoint, calibration=0)
    assert found.training["episodes"] == 640
    again = trained(episodes=640, checkpoint=checkpoint, calibration=0)
    assert_same(found, again)  # as it was left


def test_checkpoints_of_another_plant_are_refused(tmp_path):
    checkpoint = tmp_path / "agent.zip"
    trained(episodes=32, checkpoint=checkpoint, calibration=0)
    for changes, words in (
        ({"noise": 0.05}, "another plant: its noise"),
        ({"prior": {"K": (0.5, 2.1), "T": (0.2, 1.0)}}, "another plant|its compressor"),
        ({"design": lambda theta: 1.01 * plant.design(theta)}, "another plant: its design"),
    ):
        with pytest.raises(ValueError, match=f"is no checkpoint of .*{words}.* Resume with"):
            trained(described(**changes), episodes=64, checkpoint=checkpoint, calibration=0)
    (tmp_path / "agent.origin").unlink()
    with pytest.raises(ValueError, match="agent.origin: No such file.* Resume with"):
        trained(episodes=64, checkpoint=checkpoint, calibration=0)


@pytest.mark.parametrize(
    "do, words",
    [
        (lambda: trained(checkpoint=Path("gone/agent.zip")), "folder gone does not exist"),
        (lambda: Training(compressor="regularised"), "compressor = 'regularised' is unknown"),
        (lambda: trained(TASK), "plant is a Task"),
        (lambda: trained("gone:plant"), "no module 'gone'"),
        (lambda: trained(calibration=5), "calibration = 5"),
    ],
)
def test_mistakes_are_named(do, words):
    with pytest.raises(ValueError, match=words):
        do()
