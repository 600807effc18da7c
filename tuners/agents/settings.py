"""How an agent is trained; needs neither torch nor Stable-Baselines3."""

from dataclasses import dataclass

from tuners.features import BY_NAME, Features, check_features
from yawrate_env import validation

ALGORITHMS = ("sac", "ppo", "td3")


@dataclass(frozen=True, slots=True)
class Training:
    """Settings of a training run.

    Attributes
    ----------
    algorithm : {"sac", "ppo", "td3"}
        Of Stable-Baselines3.
    features : {"laguerre", "armax", "response"} or Features
        First stage; by name, Laguerre functions are those of the plant's default recipe.
    episodes : int
        Simulated episodes, one step each.
    num_envs : int
        Episodes simulated at a time.
    seed : int
        Of the agent and, shifted, of its environments.
    """

    algorithm: str = "sac"
    features: str | Features = "laguerre"
    episodes: int = 20_000
    num_envs: int = 16
    seed: int = 0

    def __post_init__(self) -> None:
        validation.one_of("algorithm", self.algorithm, ALGORITHMS)
        if isinstance(self.features, str):
            validation.one_of("features", self.features, BY_NAME)
        else:
            check_features(self.features)
        validation.count("num_envs", self.num_envs, at_least=1)
        validation.count("episodes", self.episodes, at_least=self.num_envs)
        validation.count("seed", self.seed, at_least=0)
