"""The reinforcement-learning tuner: learns from rewards alone.

An agent of Stable-Baselines3 is trained in ``yawrate/PITuningFeatures-v0``: standardised
features in, an action in loop coordinates out, one step an episode.  It sees rewards,
never the design rule's gains.  What is kept is the actor, as arrays; using it needs
neither Stable-Baselines3 nor torch.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from tuners.compressors import COMPRESSORS, compressor, described
from tuners.feature_map import ActionMap, FeatureMap
from tuners.recording import Recording
from tuners.tuner import Tuner, task_from
from yawrate_env import validation
from yawrate_env.design import Design, Status
from yawrate_env.task import Task

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

ALGORITHMS = ("sac", "ppo", "td3")


@dataclass(frozen=True, slots=True, eq=False)
class Actor:
    """A deterministic policy: a multilayer perceptron.

    Attributes
    ----------
    layers : list
        (weight (out, in), bias (out,)) pairs.
    hidden : {"relu", "tanh"}
        Activation between them.
    squashed : bool
        Whether the output goes through tanh; it is clipped to [-1, 1] otherwise.
    """

    layers: list[tuple[Array, Array]]
    hidden: str
    squashed: bool

    def __call__(self, features: NDArray[np.floating]) -> Array:
        """Features (B, n) to actions (B, 2) in [-1, 1]."""
        x = np.asarray(features, dtype=np.float64)
        for i, (weight, bias) in enumerate(self.layers):
            if i:
                x = np.maximum(x, 0) if self.hidden == "relu" else np.tanh(x)
            x = x @ weight.T + bias
        return np.tanh(x) if self.squashed else np.clip(x, -1, 1)


class RLTuner(Tuner):
    """A trained agent as a one-shot tuner."""

    kind: ClassVar[str] = "rl"

    def __init__(
        self, task: Task, features: FeatureMap, actor: Actor, training: dict[str, Any]
    ) -> None:
        super().__init__(task)
        self.features, self.actor, self.training = features, actor, training
        self._actions = ActionMap.of(task)

    def gains(self, recording: Recording) -> tuple[Design, NDArray[np.bool_]]:
        """Compress, act, map to gains."""
        if self.features.visible:
            recording = replace(recording, v_x=self.speeds(recording))
        features, usable = self.features(recording)
        kp, Ti = self._actions.gains(self.actor(features)).T
        return Design(kp, Ti, np.full(len(kp), int(Status.OK))), usable

    def settings(self) -> dict[str, Any]:
        """Task, first stage, shape of the actor and how it was trained."""
        return {
            **super().settings(),
            "compressor": described(self.features.compressor),
            "visible": list(self.features.visible),
            "hidden": self.actor.hidden,
            "squashed": self.actor.squashed,
            "training": self.training,
        }

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The actor and the standardisation of its inputs."""
        saved = {"mean": self.features.mean, "scale": self.features.scale}
        for i, (weight, bias) in enumerate(self.actor.layers):
            saved[f"weight{i}"], saved[f"bias{i}"] = weight, bias
        return saved

    @classmethod
    def from_file(cls, settings: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> Self:
        """Rebuild from what was saved."""
        depth = sum(name.startswith("weight") for name in arrays)
        layers = [(arrays[f"weight{i}"], arrays[f"bias{i}"]) for i in range(depth)]
        first_stage, visible = compressor(**settings["compressor"]), settings.get("visible", ())
        features = FeatureMap(first_stage, arrays["mean"], arrays["scale"], tuple(visible))
        actor = Actor(layers, settings["hidden"], settings["squashed"])
        return cls(task_from(settings), features, actor, settings["training"])


@dataclass(frozen=True, slots=True)
class Training:
    """How an agent is trained.

    Attributes
    ----------
    algorithm : {"sac", "ppo", "td3"}
        Of Stable-Baselines3.
    compressor : {"laguerre", "armax"}
        First stage.
    episodes : int
        Simulated episodes, one step each.
    num_envs : int
        Episodes simulated at a time.
    seed : int
        Of the agent and, shifted, of its environments.
    """

    algorithm: str = "sac"
    compressor: str = "laguerre"
    episodes: int = 20_000
    num_envs: int = 16
    seed: int = 0

    def __post_init__(self) -> None:
        validation.one_of("algorithm", self.algorithm, ALGORITHMS)
        validation.one_of("compressor", self.compressor, tuple(COMPRESSORS))
        validation.count("num_envs", self.num_envs, at_least=1)
        validation.count("episodes", self.episodes, at_least=self.num_envs)
        validation.count("seed", self.seed, at_least=0)
