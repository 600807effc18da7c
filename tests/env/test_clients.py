"""Clients that are not Stable-Baselines3, where they are installed (extra ``clients``)."""

import gymnasium
import numpy as np
import pytest

import yawrate_env

pytestmark = pytest.mark.filterwarnings("ignore")  # theirs

SHORT = {"N": 300, "Ts": 0.01}
OWN = {"plant": "first_order:plant"}
IDS = {
    yawrate_env.ENV_ID: SHORT,
    yawrate_env.NONLINEAR_ID: SHORT,
    yawrate_env.FEATURES_ID: SHORT,
    yawrate_env.PLANT_ID: OWN,
    yawrate_env.PLANT_FEATURES_ID: OWN,
}
every_id = pytest.mark.parametrize("id", IDS)


def client(name):
    reason = f'{name} is not installed: pip install "yawrate[clients]"'
    return pytest.importorskip(name, reason=reason)


def batch(id, **more):
    return gymnasium.make_vec(id, num_envs=3, **IDS[id] | more)


@every_id
@pytest.mark.parametrize("native", [False, True])
def test_torchrl_checks_the_specs_and_collects(id, native):
    client("torchrl")
    from torchrl.collectors import Collector
    from torchrl.envs import GymWrapper
    from torchrl.envs.utils import check_env_specs

    env = GymWrapper(batch(id) if native else gymnasium.make(id, **IDS[id]))
    check_env_specs(env)
    for data in Collector(env, None, frames_per_batch=12, total_frames=24):
        assert data["next", "done"].all()  # every episode has one step
        reward = data["next", "reward"]
        assert reward.numel() == 12 and (reward >= -5).all() and (reward <= 0).all()


@pytest.mark.parametrize("native", [False, True])
def test_torchrl_collects_drives(native):
    client("torchrl")
    from torchrl.collectors import Collector
    from torchrl.envs import GymWrapper
    from torchrl.envs.utils import check_env_specs

    id, short = yawrate_env.RECALIBRATION_ID, {"windows": 3, "window": 1.0}
    make = gymnasium.make_vec if native else gymnasium.make
    env = GymWrapper(make(id, **short | ({"num_envs": 4} if native else {})))
    check_env_specs(env)
    rewards = [data["next", "reward"] for data in
               Collector(env, None, frames_per_batch=12, total_frames=24)]  # fmt: skip
    assert sum(reward.numel() for reward in rewards) == 24
    assert all((reward >= -5.01).all() and (reward <= 0).all() for reward in rewards)


@every_id
def test_skrl_steps_the_native_batch(id):
    client("skrl")
    import torch
    from skrl.envs.wrappers.torch import wrap_env

    env = wrap_env(batch(id), wrapper="gymnasium")
    obs, _ = env.reset()
    assert obs.shape[0] == env.num_envs == 3
    low = env.action_space.low
    _, reward, terminated, truncated, _ = env.step(torch.tensor(np.stack([low] * 3)))
    assert terminated.all() and not truncated.any() and (reward >= -5).all()


@every_id
def test_tianshou_collects_episodes_of_one_step(id):
    client("tianshou")
    from tianshou.data import Batch, Collector, VectorReplayBuffer
    from tianshou.env import DummyVectorEnv
    from tianshou.policy import BasePolicy

    space = gymnasium.make(id, **IDS[id]).action_space

    class Lowest(BasePolicy):
        def forward(self, batch, state=None, **_):
            return Batch(act=np.stack([space.low] * len(batch.obs)))

        def learn(self, *_, **__):
            return {}

    envs = DummyVectorEnv([lambda: gymnasium.make(id, **IDS[id])] * 3)
    policy = Lowest(action_space=space)
    found = Collector(policy, envs, VectorReplayBuffer(30, 3)).collect(n_episode=6)
    assert found["n/ep"] == found["n/st"] == 6 and (found["rews"] >= -5).all()
