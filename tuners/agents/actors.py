"""Algorithms: their hyperparameters, and their actors as arrays."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm

from tuners.agents.naf import NAF
from tuners.agents.settings import Training
from tuners.learners.actor import Actor
from yawrate_env.plant.reward import error_of

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {
    "naf": NAF, "naf-plain": NAF, "sac": SAC, "ppo": PPO, "td3": TD3,
}  # fmt: skip

AVERAGED = "sac", "ppo", "td3"
"""Whose weights wander, so that their average acts better."""

_AVERAGING = 0.995
"""Weight of the past in the running average of the actor, per batch of episodes."""

_LAYERS = {
    SAC: (["latent_pi.", "mu."], "relu", True),
    TD3: (["mu."], "relu", True),
    PPO: (["mlp_extractor.policy_net.", "action_net."], "tanh", False),
}
"""Names of an actor's layers, its activation, and whether tanh squashes its output."""


def hyperparameters(training: Training, actions: int = 2) -> dict[str, Any]:
    """Keyword arguments of the algorithm, for so many numbers an action.

    Episodes have one step, so the discount is of no use; the learning rate falls linearly to
    zero, because a constant one hides the last tenths of a degree.
    """
    off_policy = {
        "learning_rate": _falling(1e-3),
        "buffer_size": training.episodes,
        "learning_starts": 32 * training.batch,
        "batch_size": 256,
        "train_freq": 1,
        "gradient_steps": training.batch,
        "gamma": 0.0,
        "policy_kwargs": {"net_arch": [64, 64]},
    }
    return {
        "naf": {"error": error_of},
        "naf-plain": {},
        "sac": {**off_policy, "target_entropy": -2.0 * actions},
        "td3": {**off_policy, "policy_delay": 2},
        "ppo": {
            "learning_rate": _falling(1e-3),
            "n_steps": 16,
            "batch_size": 64,
            "n_epochs": 10,
            "gamma": 0.0,
            "gae_lambda": 0.0,
            "policy_kwargs": {"net_arch": [64, 64], "log_std_init": -1.0},
        },
    }[training.algorithm]


@dataclass
class Average:
    """The actor's weights, averaged over the last couple of hundred batches."""

    weights: dict[str, torch.Tensor] = field(default_factory=dict)
    batches: int = 0

    def update(self, module: torch.nn.Module) -> None:
        """Add the weights after one more batch."""
        self.batches += 1
        keep = min(_AVERAGING, max(0.0, 1 - 10 / self.batches))  # the last tenth, early on
        for name, value in module.state_dict().items():
            old = self.weights.get(name, value)
            self.weights[name] = old + (1 - keep) * (value - old)


def actor_module(model: BaseAlgorithm) -> torch.nn.Module:
    """The network that acts."""
    if isinstance(model, PPO):
        return model.policy
    actor: Any = model.policy.actor
    return actor  # type: ignore[no-any-return]


def actor_of(model: BaseAlgorithm, weights: dict[str, torch.Tensor]) -> Actor:
    """The deterministic policy's layers, from averaged weights or, without any, the model's."""
    if isinstance(model, NAF):
        return Actor(model.policy.layers(), "tanh", squashed=False)
    prefixes, hidden, squashed = _LAYERS[type(model)]
    values = weights or actor_module(model).state_dict()
    names = [n for p in prefixes for n in values if n.startswith(p) and n.endswith("weight")]
    layers = [
        (_array(values[name]), _array(values[name.replace("weight", "bias")])) for name in names
    ]
    return Actor(layers, hidden, squashed)


def _array(tensor: torch.Tensor) -> Any:
    return np.asarray(tensor.detach().numpy(), dtype=np.float64)


def _falling(start: float) -> Any:
    def rate(remaining: float) -> float:
        return start * max(remaining, 0.0)

    return rate
