"""Soft actor-critic in one file, in CleanRL's manner, for one-step episodes.

python examples/cleanrl_sac.py                      # 5000 episodes, a minute or two
python examples/cleanrl_sac.py --seed 2 --total-episodes 20000 --log runs/cleanrl

One step an episode makes SAC (Haarnoja et al., 2018) a contextual bandit: the critics'
target is the reward itself, so there is no discount, no target network and no next
observation.  Needs gymnasium, numpy, torch and this project's environment; read it from
top to bottom, change what you like.
"""

import argparse
import time
from dataclasses import dataclass, fields

import gymnasium as gym
import numpy as np
import torch
from torch import nn
from torch.distributions import Normal
from torch.nn import functional as F

import yawrate_env  # noqa: F401, registers the environments


@dataclass
class Args:
    env_id: str = "yawrate/PITuningFeatures-v0"
    features: str = "laguerre"
    seed: int = 1
    total_episodes: int = 5000
    num_envs: int = 16
    learning_starts: int = 256
    updates_per_episode: float = 1.0
    batch_size: int = 256
    learning_rate: float = 2e-3
    target_entropy: float = -4.0
    hidden: int = 64
    eval_episodes: int = 1000
    log: str = ""  # folder for TensorBoard
    save: str = ""  # file for the actor's state_dict


def parse_args() -> Args:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for f in fields(Args):
        flag = "--" + f.name.replace("_", "-")
        parser.add_argument(flag, type=type(f.default), default=f.default, help=f"{f.default!r}")
    return Args(**vars(parser.parse_args()))


def mlp(inputs: int, outputs: int, hidden: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(inputs, hidden), nn.ReLU(),
        nn.Linear(hidden, hidden), nn.ReLU(),
        nn.Linear(hidden, outputs),
    )  # fmt: skip


class Actor(nn.Module):
    def __init__(self, obs_dim: int, act_dim: int, hidden: int):
        super().__init__()
        self.net = mlp(obs_dim, 2 * act_dim, hidden)

    def forward(self, obs: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Action and its log probability."""
        mean, log_std = self.net(obs).chunk(2, dim=-1)
        normal = Normal(mean, torch.exp(torch.clamp(log_std, -10, 2)))
        x = normal.rsample()
        # log(1 - tanh(x)^2), in a form that does not underflow
        squash = 2 * (np.log(2) - x - F.softplus(-2 * x))
        return torch.tanh(x), (normal.log_prob(x) - squash).sum(-1)

    def best(self, obs: torch.Tensor) -> torch.Tensor:
        return torch.tanh(self.net(obs).chunk(2, dim=-1)[0])


class Critics(nn.Module):
    """Two estimates of the reward; the actor trusts the lower one."""

    def __init__(self, obs_dim: int, act_dim: int, hidden: int):
        super().__init__()
        self.nets = nn.ModuleList(mlp(obs_dim + act_dim, 1, hidden) for _ in range(2))

    def forward(self, obs: torch.Tensor, act: torch.Tensor) -> torch.Tensor:
        x = torch.cat([obs, act], dim=-1)
        return torch.cat([net(x) for net in self.nets], dim=-1)


def evaluate(actor: Actor, args: Args) -> dict[str, np.ndarray]:
    """Deterministic actions on fresh episodes; one step of a large batch."""
    envs = gym.make_vec(args.env_id, num_envs=args.eval_episodes, features=args.features)
    obs, _ = envs.reset(seed=1_000_000_000)
    with torch.no_grad():
        *_, infos = envs.step(actor.best(torch.as_tensor(obs)).numpy())
    return infos["final_info"]


def train(args: Args) -> Actor:
    torch.set_num_threads(1)  # small networks: threads would only wait for each other
    torch.manual_seed(args.seed)
    writer = None
    if args.log:
        from torch.utils.tensorboard import SummaryWriter

        writer = SummaryWriter(f"{args.log}/sac-{args.seed}-{int(time.time())}")

    envs = gym.make_vec(args.env_id, num_envs=args.num_envs, features=args.features)
    envs.action_space.seed(args.seed)
    (obs_dim,), (act_dim,) = envs.single_observation_space.shape, envs.single_action_space.shape

    actor, critics = Actor(obs_dim, act_dim, args.hidden), Critics(obs_dim, act_dim, args.hidden)
    log_alpha = torch.zeros(1, requires_grad=True)
    optimizer = torch.optim.Adam(
        [{"params": p, "lr": args.learning_rate}
         for p in (actor.parameters(), critics.parameters(), [log_alpha])]
    )  # fmt: skip

    # One row an episode: observation, action, reward.
    memory = torch.empty(args.total_episodes + args.num_envs, obs_dim + act_dim + 1)
    count, owed, start = 0, 0.0, time.perf_counter()
    obs, _ = envs.reset(seed=1_000_000 * args.seed)
    while count < args.total_episodes:
        if count < args.learning_starts:
            actions = envs.action_space.sample()
        else:
            with torch.no_grad():
                actions = actor(torch.as_tensor(obs))[0].numpy()
        next_obs, rewards, *_ = envs.step(actions)
        rows = np.concatenate([obs, actions, rewards[:, None]], axis=1)
        memory[count : count + args.num_envs] = torch.as_tensor(rows, dtype=torch.float32)
        count, obs = count + args.num_envs, next_obs
        if count < args.learning_starts:
            continue

        # The last tenths of a degree drown in a constant learning rate.
        for group in optimizer.param_groups:
            group["lr"] = args.learning_rate * max(1 - count / args.total_episodes, 0.0)
        owed += args.updates_per_episode * args.num_envs
        for _ in range(int(owed)):
            batch = memory[torch.randint(count, (args.batch_size,))]
            o, a, r = batch.split([obs_dim, act_dim, 1], dim=-1)
            critic_loss = F.mse_loss(critics(o, a), r.expand(-1, 2))

            critics.requires_grad_(False)  # the actor's loss must not change them
            act, log_prob = actor(o)
            alpha = log_alpha.exp().detach()
            actor_loss = (alpha * log_prob - critics(o, act).min(dim=-1).values).mean()
            critics.requires_grad_(True)
            alpha_loss = -(log_alpha.exp() * (log_prob.detach() + args.target_entropy)).mean()

            optimizer.zero_grad()
            (critic_loss + actor_loss + alpha_loss).backward()
            optimizer.step()
        owed %= 1

        if count // 500 > (count - args.num_envs) // 500:
            speed = count / (time.perf_counter() - start)
            print(f"{count:6d} episodes, reward {rewards.mean():7.4f}, {speed:4.0f} episodes/s")
            if writer is not None:
                writer.add_scalar("charts/episodic_return", rewards.mean(), count)
                writer.add_scalar("losses/critic", critic_loss.item(), count)
                writer.add_scalar("losses/alpha", alpha.item(), count)
    return actor


if __name__ == "__main__":
    args = parse_args()
    actor = train(args)
    if args.save:
        torch.save(actor.state_dict(), args.save)
    info = evaluate(actor, args)
    for name, unit in (("phase_margin", "deg"), ("crossover", "Hz")):
        print(f"{name}: {info[name].mean():.4f} ± {info[name].std():.4f} {unit}")
    print(f"{(~info['stable']).sum()} of {args.eval_episodes} loops are unstable")
