"""The environments with Stable-Baselines3's own tools and agents."""

import warnings

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode
from sb3_contrib import TQC
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecMonitor

import tuners
from tuners.agents.sb3_vec_env import Sb3VecEnv
from tuners.catalogue import UNTRAINED, shipped

PLAIN, FEATURES = "yawrate/PITuning-v0", "yawrate/PITuningFeatures-v0"
SHORT = {"Ts": 0.01, "N": 300}
AVAILABLE = [name for name in tuners.NAMES if name in UNTRAINED or shipped(name).exists()]


@pytest.fixture(autouse=True, scope="module")
def _one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def adapted(count=4, id=FEATURES, **kwargs):
    return Sb3VecEnv(gymnasium.make_vec(id, num_envs=count, **SHORT | kwargs))


def actions(count, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (count, 2)).astype(np.float32)


def complaints(env):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(env)
    return [str(warning.message) for warning in caught]


def test_the_checker_minds_physical_units_and_two_rows_only():
    assert complaints(gymnasium.make(FEATURES, **SHORT, visible="context", decimate=2)) == []
    told = complaints(gymnasium.make(PLAIN))
    expected = ("unconventional shape", "symmetric and normalized", "float64")
    assert len(told) == len(expected)
    for message, words in zip(told, expected, strict=True):
        assert words in message


# --- the adapter


def test_the_batch_is_the_same_through_the_adapter():
    ours, theirs = adapted(), gymnasium.make_vec(FEATURES, num_envs=4, **SHORT)
    assert ours.num_envs == 4
    assert ours.observation_space == theirs.single_observation_space
    assert ours.action_space == theirs.single_action_space
    ours.seed(5)
    obs, expected = ours.reset(), theirs.reset(seed=5)[0]
    np.testing.assert_array_equal(obs, expected)
    for k in range(3):
        before = obs
        obs, rewards, dones, infos = ours.step(actions(4, k))
        expected, reward, _, _, info = theirs.step(actions(4, k))
        np.testing.assert_array_equal(obs, expected)
        np.testing.assert_array_equal(rewards, reward.astype(np.float32))
        assert rewards.dtype == np.float32 and dones.dtype == np.bool_ and dones.all()
        assert len(infos) == 4
        for i, one in enumerate(infos):
            np.testing.assert_array_equal(one["terminal_observation"], before[i])
            assert one["TimeLimit.truncated"] is False
            assert type(one["kp"]) is float and type(one["stable"]) is bool
            for name in ("kp", "mu_s", "phase_margin"):
                assert one[name] == info["final_info"][name][i]
            assert not any(key.startswith("_") for key in one)


def test_seeds_and_options_count_once():
    env = adapted(2)
    assert env.seed(5) == [5, 6]
    first, second = env.reset(), env.reset()
    assert (first != second).any(axis=1).all()
    env.seed(5)
    np.testing.assert_array_equal(env.reset(), first)
    np.testing.assert_array_equal(env.reset(), second)
    env.set_options({"mu_s": [0.4, 0.6], "M_delta": 50.0})
    env.reset()
    infos = env.step(actions(2))[3]
    assert [(i["mu_s"], i["M_delta"]) for i in infos] == [(0.4, 50.0), (0.6, 50.0)]
    env.set_options([{"mu_s": np.array([0.4, 0.6])}] * 2)
    env.reset()
    assert [i["mu_s"] for i in env.step(actions(2))[3]] == [0.4, 0.6]
    env.reset()
    assert [i["mu_s"] for i in env.step(actions(2))[3]] != [0.4, 0.6]
    env.set_options([{"mu_s": 0.4}, {"mu_s": 0.6}])
    with pytest.raises(ValueError, match="Give one dictionary"):
        env.reset()


def test_attributes_are_the_batches_and_cannot_be_set():
    env = adapted(3)
    assert env.get_attr("num_envs") == [3, 3, 3] and env.get_attr("num_envs", [0]) == [3]
    assert env.get_attr("render_mode", 1) == [None]
    assert env.env_is_wrapped(gymnasium.Wrapper) == [False] * 3
    with pytest.raises(AttributeError):
        env.get_attr("nothing")
    with pytest.raises(NotImplementedError, match="make_vec"):
        env.set_attr("num_envs", 2)
    with pytest.raises(NotImplementedError, match="sub-environments"):
        env.env_method("reset")
    env.close()


def gymnasiums(mode):
    return gymnasium.make_vec(
        PLAIN, num_envs=2, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode},
        **SHORT,
    )  # fmt: skip


def test_gymnasiums_same_step_batch_is_adapted_too_and_others_are_refused():
    for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED):
        with pytest.raises(ValueError, match="without a vectorization_mode"):
            Sb3VecEnv(gymnasiums(mode))
    gains = np.array([[0.2, 0.3], [0.1, 0.5]])
    results = []
    for env in (Sb3VecEnv(gymnasiums(AutoresetMode.SAME_STEP)), adapted(2, PLAIN)):
        env.seed(0)
        env.reset()
        results.append(env.step(gains))
    for one, other in zip(*(r[:3] for r in results), strict=True):
        np.testing.assert_array_equal(one, other)
    for one, other in zip(*(r[3] for r in results), strict=True):
        assert list(one) == list(other)
        np.testing.assert_array_equal(one["terminal_observation"], other["terminal_observation"])


# --- evaluate_policy


@pytest.mark.parametrize("name", AVAILABLE)
def test_evaluate_policy_takes_every_tuner(name):
    tuner = tuners.load(name)
    shown = {
        "oracle": {"visible": "context"},
        "ts-ff-lag-vx": {"visible": "speed", "v_x": [10, 33]},
        "ts-poly-any": {"visible": "speed", "v_x": [10, 33], "register": "random"},
    }
    kwargs = shown.get(name, {})
    vectors = VecMonitor(Sb3VecEnv(gymnasium.make_vec(PLAIN, num_envs=3, **kwargs)))
    mean, spread = evaluate_policy(tuner, vectors, n_eval_episodes=3)
    scalar, _ = evaluate_policy(tuner, Monitor(gymnasium.make(PLAIN, **kwargs)), 3)
    for reward in (mean, scalar):
        # Far from the nominal gains' reward is a fault, whatever the tuner.
        assert -1.2 < reward <= 0 and spread < 1
    if name == "oracle":
        assert mean == pytest.approx(0, abs=1e-4)  # observations are float32
    if name.startswith("ts-") or name in ("gb", "vrft", "frit", "rl"):
        assert mean > -0.1


def test_the_oracle_says_what_it_must_see():
    with pytest.raises(ValueError, match='visible="context"'):
        evaluate_policy(tuners.load("oracle"), Monitor(gymnasium.make(PLAIN)), 1)


# --- agents

OFF_POLICY = {"learning_starts": 8, "batch_size": 8, "buffer_size": 200}
AGENTS = {
    "ppo": (PPO, {"n_steps": 8, "batch_size": 16, "n_epochs": 2}),
    "sac": (SAC, OFF_POLICY),
    "td3": (TD3, OFF_POLICY),
    "tqc": (TQC, OFF_POLICY),
}


@pytest.mark.parametrize(("name", "id"), [*((n, FEATURES) for n in AGENTS), ("ppo", PLAIN)])
def test_agents_learn_save_and_load(name, id, tmp_path):
    algorithm, settings = AGENTS[name]
    env = VecMonitor(adapted(4, id))
    policy = {"net_arch": [8, 8]}
    agent = algorithm("MlpPolicy", env, seed=0, device="cpu", policy_kwargs=policy, **settings)
    start = [p.detach().clone() for p in agent.policy.parameters()]
    agent.learn(64)
    assert agent.num_timesteps == 64
    assert any(not torch.equal(a, b) for a, b in zip(start, agent.policy.parameters(), strict=True))
    agent.save(tmp_path / "agent.zip")
    again = algorithm.load(tmp_path / "agent.zip", env=env, device="cpu")
    obs = env.reset()
    np.testing.assert_array_equal(
        agent.predict(obs, deterministic=True)[0], again.predict(obs, deterministic=True)[0]
    )
    again.learn(32, reset_num_timesteps=False)
    assert again.num_timesteps == 96
    mean, _ = evaluate_policy(again, env, n_eval_episodes=4)
    assert -5 <= mean <= 0
