"""The normalised-advantage agent: its critic, its fit, and the algorithm."""

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.spaces import Box
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import VecNormalize

from tuners.agents.cone import Cone, fit
from tuners.agents.naf import NAF
from tuners.learners.actor import Actor

LOW, HIGH = np.array([0.0, -3.0]), np.array([10.0, 1.0])


class Target(gymnasium.Env):
    """The reward is minus the distance from a smooth function of the observation."""

    observation_space = Box(-50.0, 50.0, (2, 1))
    action_space = Box(LOW.astype(np.float32), HIGH.astype(np.float32))

    def __init__(self, noise=0.0, steps=1):
        self.noise, self.steps = noise, steps

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x, self.left = self.np_random.normal((30, -1), (5, 0.1)), self.steps
        return self.x[:, None].astype(np.float32), {}

    def step(self, action):
        self.left -= 1
        off = (action - best(self.x)) / (HIGH - LOW) * [4.0, 2.0]
        off += self.noise * self.np_random.normal(size=2)
        return self.x[:, None].astype(np.float32), -np.hypot(*off), self.left <= 0, False, {}


def best(x):
    u, v = (x[..., 0] - 30) / 5, (x[..., 1] + 1) / 0.1
    return np.stack([5 + 2 * np.tanh(u), -1 + 0.5 * np.sin(v)], axis=-1)


def agent(env, **changes):
    settings = {"seed": 0, "learning_starts": 30, "policy_kwargs": {"neurons": (5, 2)}}
    return NAF("MlpPolicy", env, **settings | {"restarts": 1} | changes)


@pytest.fixture(scope="module")
def learned():
    env = make_vec_env(Target, 10, seed=0, env_kwargs={"noise": 0.01})
    return agent(env, learning_starts=150, restarts=3).learn(800)


def off(model, count=500):
    x = np.random.default_rng(1).normal((30, -1), (5, 0.1), (count, 2))
    actions, _ = model.predict(x[:, :, None].astype(np.float32), deterministic=True)
    return (actions - best(x)) / (HIGH - LOW) * [4.0, 2.0]


# The critic


def test_slopes_are_those_of_the_errors():
    cone, rng = Cone(3, 2, (4, 2)), np.random.default_rng(0)
    weights = cone.start(rng) + 0.3 * rng.normal(size=int(cone.ends[-1]))
    x, a = rng.normal(size=(5, 3)), rng.uniform(-1, 1, (5, 2))
    e, J = cone.slopes(weights, x, a)
    np.testing.assert_allclose(e, cone.errors(weights, x, a), rtol=1e-14)
    for i in range(len(weights)):
        step = np.zeros(len(weights))
        step[i] = 1e-6
        ends = (cone.errors(weights + s * step, x, a) for s in (1, -1))
        np.testing.assert_allclose(J[:, i], np.subtract(*ends) / 2e-6, atol=1e-7)


def test_the_best_action_earns_the_least_error_and_no_other_does():
    cone, rng = Cone(3, 2), np.random.default_rng(0)
    weights, x = cone.start(rng), rng.normal(size=(20, 3))
    mu = cone.best(weights, x)
    least = cone.errors(weights, x, mu)
    np.testing.assert_allclose(least, np.exp(weights[-1]))
    assert (cone.errors(weights, x, mu + 0.01 * rng.normal(size=mu.shape)) > least).all()


def test_a_cone_is_found_again_from_its_errors():
    cone, rng = Cone(2, 2, (3, 2)), np.random.default_rng(0)
    truth = cone.start(rng)
    x, a = rng.normal(size=(2000, 2)), rng.uniform(-1, 1, (2000, 2))
    e = cone.errors(truth, x, a)
    near = truth + 0.1 * rng.normal(size=len(truth))
    found, cost = fit(cone, near, x, a, e, np.ones(2000), 100)
    assert cost < 1e-8 * ((cone.errors(near, x, a) - e) ** 2).sum()
    np.testing.assert_allclose(cone.best(found, x), cone.best(truth, x), atol=1e-4)


def test_a_row_without_weight_does_not_count():
    cone, rng = Cone(2, 1, (2, 2)), np.random.default_rng(0)
    x, a = rng.normal(size=(100, 2)), rng.uniform(-1, 1, (100, 1))
    e, weight = np.abs(a[:, 0] - 0.3), np.ones(100)
    start = cone.start(rng)
    expected, _ = fit(cone, start, x[:80], a[:80], e[:80], weight[:80], 10)
    weight[80:], e[80:] = 0.0, 1e3
    found, _ = fit(cone, start, x, a, e, weight, 10)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)


# The algorithm


def test_it_finds_the_best_actions_to_the_noise(learned):
    # 800 rewards of noise 0.01 for 43 weights: 0.01 sqrt(43/800), and what 5 tanh cannot be.
    assert np.sqrt((off(learned) ** 2).mean()) < 0.01
    assert learned.num_timesteps == learned.episodes == 800
    mean, _ = evaluate_policy(learned, learned.env, n_eval_episodes=50)
    assert -0.03 < mean < 0


def test_exploration_narrows_to_the_root_of_the_noise(learned):
    assert learned.policy.array("spread") < 0.25 < 0.7
    obs = np.repeat(np.array([[[30.0], [-1.0]]], dtype=np.float32), 200, axis=0)
    torch.manual_seed(0)
    actions, _ = learned.predict(obs, deterministic=False)
    assert actions.std(axis=0).min() > 0
    assert (actions >= LOW - 1e-5).all() and (actions <= HIGH + 1e-5).all()


def test_a_saved_model_acts_alike_and_learns_on(learned, tmp_path):
    learned.save(tmp_path / "naf.zip")
    again = NAF.load(tmp_path / "naf.zip", env=learned.env)
    np.testing.assert_array_equal(off(again), off(learned))
    assert again.episodes == 800
    again.learn(100, reset_num_timesteps=False)
    assert again.num_timesteps == again.episodes == again.fitted == 900
    assert (off(again) != off(learned)).any()


def test_the_exported_actor_acts_alike(learned):
    x = np.random.default_rng(2).normal((30, -1), (5, 0.1), (20, 2))
    unit = Actor(learned.policy.layers(), "tanh", squashed=False)(x)
    actions, _ = learned.predict(x[:, :, None], deterministic=True)
    np.testing.assert_allclose(learned.policy.unscale_action(unit), actions, rtol=1e-4)


def test_a_seed_repeats_the_training_and_one_environment_is_enough():
    runs = [agent(Target(), seed=seed).learn(50) for seed in (0, 0, 1)]
    for model in runs:
        assert model.fitted == 50
    np.testing.assert_array_equal(off(runs[0]), off(runs[1]))
    assert (off(runs[0]) != off(runs[2])).any()


class Counting(BaseCallback):
    def __init__(self, most):
        super().__init__()
        self.most, self.ends = most, []

    def _on_step(self):
        return self.num_timesteps < self.most

    def _on_rollout_end(self):
        self.ends.append(self.num_timesteps)


def test_callbacks_and_the_logger_follow(tmp_path):
    model = agent(Target(), learning_starts=40, growth=2.0)
    model.set_logger(configure(str(tmp_path), ["csv"]))
    counting = Counting(1000)
    model.learn(100, counting)
    model.logger.close()
    assert counting.ends == [40, 80, 100]
    lines = (tmp_path / "progress.csv").read_text().splitlines()
    assert len(lines) == 4 and "train/noise" in lines[0] and "rollout/ep_rew_mean" in lines[0]
    model.learn(100, Counting(30))
    assert model.num_timesteps == 30  # stopped


def test_a_unit_scales_rewards_as_it_says():
    class Tenfold(Target):
        def step(self, action):
            obs, reward, *rest = super().step(action)
            return obs, 10 * reward, *rest

    plain, scaled = agent(Target()).learn(30), agent(Tenfold(), unit=10.0).learn(30)
    np.testing.assert_allclose(scaled.memory[2], plain.memory[2], rtol=1e-6)


def test_what_it_cannot_learn_is_refused():
    with pytest.raises(ValueError, match="env"):
        NAF("MlpPolicy", Target(steps=2)).learn(10)
    with pytest.raises(ValueError, match="env"):
        NAF("MlpPolicy", VecNormalize(make_vec_env(Target, 2)))
    with pytest.raises(ValueError, match="error"):
        NAF("MlpPolicy", Target(), error=lambda r: r[:0]).learn(10)
    for name, value in (("unit", 0.0), ("growth", 1.0), ("learning_starts", 0), ("restarts", -1)):
        with pytest.raises(ValueError, match=name):
            NAF("MlpPolicy", Target(), **{name: value})


def test_recorded_episodes_teach_as_their_own_would():
    env, rng = make_vec_env(Target, 1, seed=0), np.random.default_rng(0)
    x = rng.normal((30, -1), (5, 0.1), (700, 2))
    near = rng.random((700, 1)) < 0.5
    actions = np.where(near, best(x) + [0.4, 0.2] * rng.normal(size=x.shape),
                       rng.uniform(LOW, HIGH, x.shape)).clip(LOW, HIGH)  # fmt: skip
    rewards = -np.linalg.norm((actions - best(x)) / (HIGH - LOW) * [4.0, 2.0], axis=1)
    model = agent(env, learning_starts=150)
    model.learn_offline(x[:, :, None], actions, rewards)
    assert model.episodes == model.fitted == 700 and model.num_timesteps == 0
    assert np.sqrt((off(model) ** 2).mean()) < 0.05
