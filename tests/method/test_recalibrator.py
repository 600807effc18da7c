"""The agent of re-calibration: its memory against a Kalman filter, and what it learns."""

import numpy as np
import pytest

from tuners.agents import memory
from tuners.agents.recalibrator import Recalibrator
from yawrate_env.env.recalibration_env import PIRecalibrationVectorEnv

NEVER = np.array([np.log(0.1), np.log(0.02), 0.0, -12.0, 0.0])  # hardly ever jumps


def told(z, spread):
    """Observations (B, 9) of estimates (B, 2) that the prior pulled, with these deviations."""
    obs = np.zeros((len(z), 9))
    obs[:, :2], obs[:, 2:4] = z, np.log(spread)
    return obs


def drives(T=30, B=4, seed=0):
    rng = np.random.default_rng(seed)
    obs = told(rng.normal(size=(T * B, 2)), rng.uniform(0.2, 0.9, (T * B, 2))).reshape(T, B, 9)
    starts = rng.random((T, B)) < 0.1
    starts[0] = True
    return obs, starts


def test_memory_is_a_kalman_filter_where_nothing_jumps():
    obs, starts = drives(T=12, B=1)
    starts[1:] = False
    now = memory.blank(1)
    mean, variance = np.zeros(2), np.ones(2)
    for t in range(12):
        now = memory.remembered(NEVER, now, obs[t], starts[t])
        variance = variance + (t > 0) * np.exp(NEVER[:2])
        posterior = np.exp(2 * obs[t, 0, 2:4])
        F, i = 1 / posterior - 1, obs[t, 0, :2] / posterior
        mean, variance = (mean / variance + i) / (1 / variance + F), 1 / (1 / variance + F)
    np.testing.assert_allclose(now.mean[0], mean, atol=2e-3)
    np.testing.assert_allclose(np.diag(now.covariance[0]), variance, atol=2e-3)


def test_a_start_forgets_and_the_first_window_is_as_told():
    obs, starts = drives()
    now = memory.remembered(NEVER, memory.blank(4), obs[0], starts[0])
    np.testing.assert_allclose(now.mean, obs[0, :, :2], atol=1e-12)
    again = memory.remembered(NEVER, now, obs[0], starts[0])
    np.testing.assert_array_equal(again.mean, now.mean)


def test_replayed_is_remembered_window_by_window_for_every_setting():
    obs, starts = drives()
    settings = np.stack([NEVER, memory.FORGETFUL])
    found = memory.replayed(settings, obs, starts)
    for each, expected in zip(settings, found, strict=True):
        now, rows = memory.blank(4), []
        for t in range(len(obs)):
            now = memory.remembered(each, now, obs[t], starts[t])
            rows.append(memory.inputs(now, obs[t]))
        np.testing.assert_allclose(np.concatenate(rows), expected, rtol=1e-12)


def walked(total=6000, B=100, seed=0):
    """Windows of a number that walks (0.1 a window), seen with noise; a second one stays.

    The error is the distance from actions that suit the truth.
    """
    rng, T = np.random.default_rng(seed), total // B
    z = rng.normal(size=(B, 2))
    obs, actions, errors = [], [], []
    for _ in range(T):
        z = z + [0.1, 0.0] * rng.normal(size=(B, 2))
        precision = 1 + 1 / 0.6**2
        seen = (z + 0.6 * rng.normal(size=z.shape)) / 0.6**2 / precision
        obs.append(told(seen, np.full((B, 2), precision**-0.5)))
        actions.append(rng.uniform(-1, 1, (B, 2)))
        errors.append(2 * np.linalg.norm(actions[-1] - 0.2 * z, axis=1))
    starts = np.zeros((T, B), np.bool_)
    starts[0] = True
    return np.stack(obs), starts, np.concatenate(actions), np.concatenate(errors)


def test_rewards_tell_how_much_to_remember():
    agent = Recalibrator(seed=0)
    for known in (2000, 4000, 6000):
        obs, starts, a, e = (part[: known if part.ndim == 1 or part.shape[1] == 2 else known // 100]
                             for part in walked())  # fmt: skip
        agent.fit(obs, starts, a, e, known - 2000)
    first, second = np.exp(agent.settings[:2] / 2)
    assert 0.06 < first < 0.17 and second < 0.5 * first
    x = np.array([[0.5, -0.5, 0.0]])
    np.testing.assert_allclose(agent.best(x), [[0.1, -0.1]], atol=0.02)


@pytest.fixture(scope="module")
def learned():
    return Recalibrator(seed=0, learning_starts=100, restarts=1).learn(
        PIRecalibrationVectorEnv(20), 600
    )


def test_prediction_carries_its_memory_and_takes_one_observation_or_many(learned):
    obs, starts = drives(T=3)
    state, seen = None, []
    for t in range(3):
        actions, state = learned.predict(obs[t], state, starts[t] if t else None)
        seen.append(actions)
    assert seen[0].shape == (4, 3) and seen[0].dtype == np.float32
    (x,) = memory.replayed(learned.settings[None], obs, starts)
    expected = learned.best(x).reshape(3, 4, 2)
    np.testing.assert_allclose(np.stack(seen)[:, :, :2], expected, rtol=1e-5, atol=1e-6)
    one, _ = learned.predict(obs[0, 0])
    np.testing.assert_allclose(one, seen[0][0], rtol=1e-6)


def test_a_seed_gives_an_agent_and_files_keep_it(learned, tmp_path):
    again = Recalibrator(seed=0, learning_starts=100, restarts=1).learn(
        PIRecalibrationVectorEnv(20), 600
    )
    again.save(tmp_path / "agent.npz")
    found = Recalibrator.load(tmp_path / "agent.npz")
    x = np.random.default_rng(0).normal(size=(9, 3))
    np.testing.assert_array_equal(found.best(x), learned.best(x))
    np.testing.assert_array_equal(found.settings, learned.settings)


def test_what_has_learned_nothing_says_so(tmp_path):
    with pytest.raises(ValueError, match="learn"):
        Recalibrator().predict(np.zeros(9))
    with pytest.raises(ValueError, match="growth"):
        Recalibrator(growth=1.0)
