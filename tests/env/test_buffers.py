"""Memory of observations: used again, but never while somebody looks at it."""

import resource

import gymnasium as gym
import numpy as np
import pytest

from yawrate_env import ENV_ID
from yawrate_env.env.buffers import Buffers

SHAPE = (4, 3)


def address(array):
    return array.__array_interface__["data"][0]


@pytest.mark.parametrize("view", [
    lambda a: a, lambda a: a[1], lambda a: a[2:].T, lambda a: list(a)[-1],
    lambda a: a[:].view(np.int32), lambda a: memoryview(a), lambda a: a.reshape(-1)[::2],
])  # fmt: skip
def test_memory_comes_back_when_the_last_view_is_gone(view):
    buffers = Buffers(SHAPE, np.float32)
    first = buffers.empty()
    place, kept = address(first), view(first)
    del first
    other = buffers.empty()
    assert address(other) != place
    del kept
    assert address(buffers.empty()) == place


def test_memory_outlives_its_buffers():
    array = Buffers(SHAPE, np.float32).empty()
    array[:] = 1.0
    assert array.sum() == 12 and array.flags.writeable and array.shape == SHAPE


def test_kept_observations_do_not_change():
    envs = gym.make_vec(ENV_ID, num_envs=3, N=1000)
    actions = np.tile([0.2, 0.2], (3, 1))
    kept = [envs.reset(seed=0)[0]]
    finals = []
    for _ in range(8):
        obs, *_, info = envs.step(actions)
        kept.append(obs)
        finals.append(info["final_obs"])
    copies = [obs.copy() for obs in kept]
    for _ in range(4):
        envs.step(actions)
    np.testing.assert_array_equal(kept, copies)
    for obs, final in zip(kept, finals, strict=False):
        np.testing.assert_array_equal(obs, np.stack(final))


def test_steps_need_no_fresh_memory():
    """The observations of 64 episodes take 1300 pages; half of the steps take 30 or fewer."""
    envs = gym.make_vec(ENV_ID, num_envs=64)
    actions = np.tile([0.2, 0.2], (64, 1))
    obs, _ = envs.reset(seed=0)
    faults = []
    for _ in range(25):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        obs, *_ = envs.step(actions)
        faults.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
    assert obs.nbytes > 4096 * 1200
    assert np.median(faults[5:]) <= 30, faults
