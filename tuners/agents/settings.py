"""Settings of an agent's training; needs neither torch nor Stable-Baselines3."""

from dataclasses import dataclass

from tuners.features import BY_NAME, Features, check_features
from yawrate_env import validation

ALGORITHMS = ("naf", "naf-plain", "sac", "ppo", "td3")

_NUM_ENVS = {"naf": 100, "naf-plain": 100}


@dataclass(frozen=True, slots=True)
class Training:
    """Settings of a training run.

    Attributes
    ----------
    algorithm : {"naf", "naf-plain", "sac", "ppo", "td3"}
        `tuners.agents.naf`, which knows the reward's form or does without (``plain``), or one of
        Stable-Baselines3's own.
    features : {"laguerre", "armax", "response"} or Features
        First stage; by name, Laguerre functions are those of the plant's default recipe.
    episodes : int
        Simulated episodes, one step each.
    num_envs : int, optional
        Episodes simulated at a time; 100 for ``naf``, else 16.
    seed : int
        Of the agent and, shifted, of its environments.
    """

    algorithm: str = "naf"
    features: str | Features = "laguerre"
    episodes: int = 20_000
    num_envs: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        validation.one_of("algorithm", self.algorithm, ALGORITHMS)
        if isinstance(self.features, str):
            validation.one_of("features", self.features, BY_NAME)
        else:
            check_features(self.features)
        if self.num_envs is not None:
            validation.count("num_envs", self.num_envs, at_least=1)
        validation.count("episodes", self.episodes, at_least=self.batch)
        validation.count("seed", self.seed, at_least=0)

    @property
    def batch(self) -> int:
        """Episodes simulated at a time."""
        return self.num_envs or _NUM_ENVS.get(self.algorithm, 16)

    @property
    def name(self) -> str:
        """What the tuner is called."""
        return "rl" if self.algorithm == "naf" else f"rl-{self.algorithm}"
