"""The vehicles' reinforcement-learning tuner, and how agents are trained: from rewards alone.

An agent of Stable-Baselines3 is trained in ``yawrate/PITuningFeatures-v0``: standardised
features in, an action in loop coordinates out, one step an episode.  It sees rewards,
never the design rule's gains.  What is kept is the actor, as arrays; using it needs
neither Stable-Baselines3 nor torch.  For any other plant `tuners.agents.training.train_plant`
does the same, and gives a `tuners.plants.PlantTuner`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from tuners.agents.feature_map import ActionMap, FeatureMap
from tuners.features import BY_NAME, compressor, described
from tuners.learners.actor import Actor
from tuners.tuner.recording import Recording
from tuners.tuner.tuner import Tuner, task_from
from yawrate_env import validation
from yawrate_env.loop.design import Design, Status
from yawrate_env.vehicle.task import Task

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

ALGORITHMS = ("sac", "ppo", "td3")


class RLTuner(Tuner):
    """A trained agent as a one-shot tuner."""

    kind: ClassVar[str] = "rl"

    def __init__(
        self,
        task: Task,
        features: FeatureMap,
        visible: tuple[str, ...],
        actor: Actor,
        training: dict[str, Any],
    ) -> None:
        super().__init__(task)
        self.features, self.visible, self.actor = features, visible, actor
        self.training = training
        self._actions = ActionMap.of(self.plant)

    def gains(self, recording: Recording) -> tuple[Design, NDArray[np.bool_]]:
        """Compress, act, map to gains."""
        if self.visible:
            recording = replace(recording, v_x=self.speeds(recording))
        beside = recording.beside(self.visible)
        features, usable = self.features(recording.u, recording.y, recording.Ts, beside)
        kp, Ti = self._actions.gains(self.actor(features)).T
        return Design(kp, Ti, np.full(len(kp), int(Status.OK))), usable

    def settings(self) -> dict[str, Any]:
        """Task, first stage, shape of the actor and how it was trained."""
        return {
            **super().settings(),
            "compressor": described(self.features.compressor),
            "visible": list(self.visible),
            "hidden": self.actor.hidden,
            "squashed": self.actor.squashed,
            "training": self.training,
        }

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The actor and the standardisation of its inputs."""
        around = {"mean": self.features.mean, "scale": self.features.scale}
        return around | self.actor.arrays()

    @classmethod
    def from_file(cls, settings: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> Self:
        """Rebuild from what was saved."""
        first_stage, visible = compressor(**settings["compressor"]), settings.get("visible", ())
        features = FeatureMap(first_stage, arrays["mean"], arrays["scale"])
        actor = Actor.of(arrays, settings["hidden"], settings["squashed"])
        return cls(task_from(settings), features, tuple(visible), actor, settings["training"])


@dataclass(frozen=True, slots=True)
class Training:
    """How an agent is trained.

    Attributes
    ----------
    algorithm : {"sac", "ppo", "td3"}
        Of Stable-Baselines3.
    compressor : {"laguerre", "armax", "response"}
        First stage; a plant's Laguerre functions are those of its default recipe.
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
        validation.one_of("compressor", self.compressor, BY_NAME)
        validation.count("num_envs", self.num_envs, at_least=1)
        validation.count("episodes", self.episodes, at_least=self.num_envs)
        validation.count("seed", self.seed, at_least=0)
