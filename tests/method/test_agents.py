"""Agents: their training, their checkpoints, and the tuners that they become."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch
from first_order import described, lone, plant
from recordings import recorded

import tuners
from tuners.agents.actors import Average, actor_of
from tuners.agents.feature_map import FeatureMap
from tuners.agents.settings import ALGORITHMS
from tuners.agents.training import Run, Training, snapshots, train
from tuners.catalogue import AGENTS
from tuners.features.laguerre import Laguerre
from tuners.learners.actor import Actor, Agent
from tuners.tuner.recording import Recording
from yawrate_env import PLANT_FEATURES_ID, PLANT_ID
from yawrate_env.plant import episodes
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

ENVS = 4
EPISODES = 148  # SAC and TD3 start to learn after 32 batches
DEMANDING = replace(lone, target=(0.3,))  # gains 30 % above the design rule's
ON_AND_OFF_POLICY = "ppo", "sac"
FAMILIES = *ON_AND_OFF_POLICY, "naf"
EVERY_SPEED = yaw_rate(Task(prior=Prior(v_x=(10.0, 30.0)), experiment=Experiment(Ts=0.01, N=300)))


def settings(algorithm="sac", **others):
    return Training(algorithm, **{"episodes": EPISODES, "num_envs": ENVS, **others})


def trained(of=plant, algorithm="sac", calibration=0, at=None, **others):
    """A tuner; with `at`, the snapshots."""
    run = {name: others.pop(name) for name in ("checkpoint", "progress", "log") if name in others}
    if at is not None:
        return snapshots(settings(algorithm, **others), of, at, **run)
    return train(settings(algorithm, **others), of, calibration=calibration, **run)


@cache
def default(algorithm):
    return trained(algorithm=algorithm)


@cache
def agent():
    return trained(DEMANDING, episodes=800, calibration=64)


def differ(a, b):
    pairs = a.method.arrays(), b.method.arrays()
    assert set(pairs[0]) == set(pairs[1])
    return any((array != pairs[1][name]).any() for name, array in pairs[0].items())


def test_set(of, count, seed=0):
    found = episodes.recorded(of, "test", seed, count)
    return found.theta, Recording(found.u, found.y, of.Ts, found.theta)


test_set.__test__ = False


def reward_of(tuner, count=128):
    theta, recording = test_set(tuner.plant, count)
    return tuner.plant.reward(theta, tuner.gains(recording).values).mean()


# Training


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_training_gives_snapshots_and_the_end(algorithm):
    run, calls = Run(settings(algorithm, episodes=150), plant), []
    found = run.learn((142, 40, 4), lambda *call: calls.append(call))
    # PPO ends with a whole rollout of 64.
    end = 192 if algorithm == "ppo" else 152
    assert [n for n, _ in found] == [4, 40, 142, end]
    assert [t.training["episodes"] for _, t in found] == [4, 40, 144, end]
    record = found[-1][1].training
    name = "rl" if algorithm == "naf" else f"rl-{algorithm}"
    assert (record["name"], record["algorithm"], record["num_envs"]) == (name, algorithm, ENVS)
    assert differ(found[0][1], found[-1][1])
    done = [d for _, d, _ in calls]
    assert {(what, of) for what, _, of in calls} == {(f"training {name}", 150)}
    assert done == sorted(done) and done[-1] == 150

    width = run.env.observation_space.shape[0]
    features = np.random.default_rng(0).normal(size=(20, width)).astype(np.float32)
    expected, _ = run.model.predict(features, deterministic=True)
    # The network calculates in float32.
    np.testing.assert_allclose(actor_of(run.model, {})(features), expected, rtol=0, atol=1e-5)


def test_nothing_is_learned_from_random_actions_only():
    (_, early), (_, late) = trained(at=(4,), episodes=128)
    assert not differ(early, late)


@pytest.mark.parametrize("algorithm", FAMILIES)
def test_a_seed_gives_the_same_agent_again_and_another_another(algorithm):
    again, other = (trained(algorithm=algorithm, seed=s) for s in (0, 1))
    assert not differ(default(algorithm), again)
    assert differ(default(algorithm), other)


def seeds_of(run):
    run.env.reset()
    return set(run.env.env.unwrapped.np_random_seed)


def test_agents_of_other_seeds_observe_other_episodes():
    seen = [seeds_of(Run(settings(seed=seed), plant)) for seed in range(3)]
    assert len(set.union(*seen)) == 3 * ENVS


@pytest.mark.parametrize("algorithm", FAMILIES)
def test_training_never_reads_the_design_rules_gains(algorithm):
    blind = False

    def design(theta):
        return np.full((len(theta), 2), np.nan) if blind else plant.design(theta)

    own = described(
        design=design,
        evaluate=lambda theta, gains: gains / plant.design(theta) - 1,
        metrics={"error of kp": 0.3, "error of Ti": 0.3},
        target=(0.0, 0.0),
    )
    ((_, expected),) = Run(settings(algorithm), own).learn()
    run = Run(settings(algorithm), own)
    blind = True  # the bounds of the actions are all that the agent got of it
    ((_, found),) = run.learn()
    assert not differ(expected, found)


def test_rewards_are_what_is_learned_from(monkeypatch):
    # The counterpart of the test above: it would notice a difference.
    monkeypatch.setattr(Plant, "reward_of", lambda self, errors: np.zeros(len(errors)))
    assert differ(trained(), default("sac"))


@pytest.mark.slow
def test_an_agent_learns_what_earns_rewards_where_the_design_rule_earns_none():
    theta, _ = test_set(DEMANDING, 128)
    rule = DEMANDING.reward(theta, DEMANDING.oracle(theta))
    np.testing.assert_allclose(rule, -1 / (1 + 1 / 4))
    right_in_the_middle = 1.3 * DEMANDING.oracle(DEMANDING.middle).repeat(128, axis=0)
    fixed = DEMANDING.reward(theta, right_in_the_middle).mean()
    start = reward_of(trained(DEMANDING, episodes=16))
    assert reward_of(agent()) > 0.7 * rule.mean() > max(fixed, start)


def test_the_log_is_tensorboards(tmp_path):
    trained(algorithm="ppo", episodes=64, log=str(tmp_path))
    assert list(tmp_path.rglob("events.out.tfevents.*"))


@pytest.mark.parametrize(
    "do, name",
    [
        (lambda: Training("dqn"), "algorithm = 'dqn'"),
        (lambda: Training(features="regularised"), "features = 'regularised'"),
        (lambda: Training(features=3), "features"),
        (lambda: Training(episodes=8), "episodes = 8"),
        (lambda: Training(num_envs=0), "num_envs = 0"),
        (lambda: trained(checkpoint=Path("gone/agent.zip")), "gone"),
        (lambda: trained(Task()), "entry"),
        (lambda: trained("gone:plant"), "'gone'"),
        (lambda: trained(calibration=5), "calibration = 5"),
    ],
)
def test_mistakes_are_named(do, name):
    with pytest.raises(ValueError, match=name):
        do()


# Checkpoints


class Interrupted(Exception):
    pass


def interrupted(algorithm, checkpoint, at):
    """A training that stops one batch after its checkpoint."""

    def stop(what, done, of):
        if done > at:
            raise Interrupted

    with pytest.raises(Interrupted):
        trained(algorithm=algorithm, at=(at,), checkpoint=checkpoint, episodes=200, progress=stop)


@pytest.mark.parametrize("algorithm", ON_AND_OFF_POLICY)
def test_a_resumed_training_goes_on_where_it_was(algorithm, tmp_path):
    checkpoint, whole = tmp_path / "checkpoint", settings(algorithm, episodes=200)
    interrupted(algorithm, checkpoint, at=136)
    files = {"checkpoint" + end for end in ("", ".average.pt", ".buffer.pkl", ".origin")}
    files -= {"checkpoint.buffer.pkl"} if algorithm == "ppo" else set()
    assert {path.name for path in tmp_path.iterdir()} == files

    run = Run(whole, plant, checkpoint=checkpoint)
    assert run.model.num_timesteps == 136 and run.average.batches == 34
    if algorithm != "ppo":
        assert run.model.replay_buffer.size() == 33  # the batch of the checkpoint is lost
    assert not seeds_of(run) & seeds_of(Run(whole, plant))  # never the same episodes twice

    found = trained(algorithm=algorithm, episodes=200, checkpoint=checkpoint, at=(4, 136, 160))
    end = 136 + 64 if algorithm == "ppo" else 200
    assert [n for n, _ in found] == [160, end]
    assert found[-1][1].training["episodes"] == end


def test_a_resumed_critic_keeps_its_episodes(tmp_path):
    checkpoint = tmp_path / "checkpoint"
    interrupted("naf", checkpoint, at=136)
    run = Run(settings("naf", episodes=200), plant, checkpoint=checkpoint)
    assert run.model.num_timesteps == run.model.episodes == 136
    ((_, found),) = run.learn()
    assert run.model.episodes == run.model.fitted == found.training["episodes"] == 200


def test_checkpoints_of_another_training_are_refused(tmp_path):
    checkpoint = tmp_path / "agent.zip"
    trained(episodes=32, checkpoint=checkpoint)
    refused = [
        (plant, {"algorithm": "td3"}, "algorithm"),
        (plant, {"features": "armax"}, "features"),
        (described(noise=0.05), {}, "noise"),
        (described(prior={"K": (0.5, 2.1), "T": (0.2, 1.0)}), {}, "prior|features"),
        (described(design=lambda theta: 1.01 * plant.design(theta)), {}, "design"),
    ]
    for of, changes, name in refused:
        with pytest.raises(ValueError, match=f"checkpoint .*agent.zip .*{name}"):
            trained(of, episodes=64, checkpoint=checkpoint, **changes)
    for spoil in (Path.unlink, lambda path: path.write_text("[]")):
        spoil(tmp_path / "agent.origin")
        with pytest.raises(ValueError, match="agent.zip .*agent.origin"):
            trained(episodes=64, checkpoint=checkpoint)


def test_a_finished_training_is_found_as_it_was_and_other_files_are_no_checkpoints(tmp_path):
    path = tmp_path / "agent.zip"
    first, again = (trained(checkpoint=path) for _ in range(2))
    assert not differ(first, again)
    path.write_bytes(b"PK, but nothing more")
    with pytest.raises(ValueError, match=r"checkpoint .*agent\.zip"):
        trained(checkpoint=path)


# The actor


def test_an_actor_by_hand():
    layers = [(np.array([[1.0], [-1.0]]), np.array([0.0, 0.5])),
              (np.array([[2.0, 1.0]]), np.array([0.25]))]  # fmt: skip
    x = np.array([[1.0], [-2.0]])
    relu = np.array([[2 + 0 + 0.25], [0 + 2.5 + 0.25]])
    np.testing.assert_allclose(Actor(layers, "relu", True)(x), np.tanh(relu))
    np.testing.assert_allclose(Actor(layers, "relu", False)(x), 1.0)
    tanh = 2 * np.tanh(x) + np.tanh(0.5 - x) + 0.25
    np.testing.assert_allclose(Actor(layers, "tanh", False)(x), np.clip(tanh, -1, 1))


def test_the_average_forgets_the_beginning_and_smooths_the_end():
    module, average = torch.nn.Linear(1, 1), Average()

    def after(count, value):
        for k in range(count):
            for p in module.parameters():
                p.data.fill_(value(k))
            average.update(module)
        return float(average.weights["weight"])

    assert after(10, lambda k: k) == 9  # as good as the last
    assert after(90, lambda k: 1.0) == pytest.approx(1.0, abs=1e-5)  # the 9 is forgotten
    assert after(5000, lambda k: (-1.0) ** k) == pytest.approx(0, abs=0.01)
    # A step decays by 0.995 a batch from then on.
    assert after(200, lambda k: 1.0) == pytest.approx(1 - 0.995**200, abs=0.01)


# The tuner


def test_saving_keeps_everything(tmp_path):
    agent().save(tmp_path / "rl.tuner")
    again = tuners.load(tmp_path / "rl.tuner", DEMANDING)
    assert isinstance(again.method.learner, Agent) and not differ(agent(), again)
    assert again.training == agent().training and again.calibration == agent().calibration
    y = lone.respond(np.array([[1.2, 0.5]]))[0] + 0.02 * np.random.default_rng(0).normal(size=500)
    one, other = (t.tune(lone.u, y) for t in (agent(), again))
    assert (one.gains, one.intervals, one.checks) == (other.gains, other.intervals, other.checks)


def test_intervals_are_calibrated():
    theta, recording = test_set(DEMANDING, 200, seed=1)
    gains, found = agent().assess(recording)
    off = np.abs(DEMANDING.metric_values(theta, gains.values) - found.metrics)
    held = off <= np.array(agent().calibration) * found.spread
    # 90 % intervals from 64 episodes: 0.9 within 3.5 standard deviations of both samples.
    assert (held.mean(axis=0) > 0.75).all()
    missed = np.abs(DEMANDING.errors(theta, gains.values)) / DEMANDING.metric_setting("error")
    assert found.trusted.any()
    assert missed[found.trusted].max() < 1.5 < missed[~found.trusted].max()


def test_it_acts_in_both_environments_alike():
    raw = gymnasium.make(PLANT_ID, plant=DEMANDING)
    features = gymnasium.make(PLANT_FEATURES_ID, plant=DEMANDING)
    learner = agent().method.learner
    for seed in range(3):
        action, _ = agent().predict(raw.reset(seed=seed)[0])
        own = learner.actor(features.reset(seed=seed)[0][None])[0]
        a, b = raw.step(action)[4], features.step(own.astype(np.float32))[4]
        assert a["kp"] == pytest.approx(b["kp"], rel=1e-5) and not a["clipped"]


def test_measured_parameters_are_features():
    of = EVERY_SPEED
    found = trained(of, "ppo", episodes=64)
    (name,) = of.measured_names
    low, high = of.prior[name]
    y = of.respond(of.middle)[0]
    slow, fast = (found.act(Recording.of(of, of.u, y, measured={name: v})) for v in (low, high))
    assert (slow != fast).all()
    with pytest.raises(ValueError, match=f"{name} is needed"):
        found.tune(of.u, y)


@pytest.mark.parametrize("name", AGENTS)
def test_the_shipped_agents_keep_their_features(name):
    tuner = tuners.load(name)
    assert (tuner.training["algorithm"], tuner.training["episodes"]) == (AGENTS[name], 20_000)
    stage, learner, vehicles = tuner.method.features, tuner.method.learner, tuner.plant
    assert stage == Laguerre()
    features = FeatureMap.of(vehicles, stage, vehicles.measured_features)
    np.testing.assert_allclose(learner.mean, features.mean, rtol=1e-6)
    np.testing.assert_allclose(learner.scale, features.scale, rtol=1e-6)
    given = recorded(20)
    values = vehicles.metric_values(given.known, tuner.gains(given).values)
    assert (np.abs(values - [60, 1.5]) < [1.0, 0.03]).all()
