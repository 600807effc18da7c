"""Agents learn: Stable-Baselines3's models, trained for vehicles or for any plant.

`train` gives the vehicles' `RLTuner`, `train_plant` a plant's `PlantTuner`; the run is the
same.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from tuners.agents.checkpoint import Origin
from tuners.agents.feature_map import ActionMap, FeatureMap
from tuners.agents.rl_tuner import Progress, RLTuner, Training
from tuners.agents.sb3_vec_env import Sb3VecEnv
from tuners.agents.wrappers import base_env
from tuners.features import described as described_stage
from tuners.learners.actor import Actor, Agent
from tuners.learners.threads import threads
from tuners.trust.black_box import functions_for
from tuners.tuner.plant_tuner import PlantTuner
from tuners.tuner.stages import Stages
from tuners.tuner.training import CALIBRATION, calibrate, check_calibration, described
from yawrate_env import FEATURES_ID, PLANT_FEATURES_ID
from yawrate_env.env.interaction import VISIBLE
from yawrate_env.env.nonlinear_env import PITuningNonlinearEnv
from yawrate_env.files import check_folder, replacing
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.yaw_rate import yaw_rate

Made = TypeVar("Made")
Maker = Callable[[Actor, dict[str, Any]], Made]
"""A tuner from an actor, and how that was trained."""

CLASSES: dict[str, type[BaseAlgorithm]] = {"sac": SAC, "ppo": PPO, "td3": TD3}

_AVERAGING = 0.995
"""Weight of the past in the running average of the actor, per batch of episodes."""


def hyperparameters(settings: Training, actions: int = 2) -> dict[str, Any]:
    """Keyword arguments of the algorithm, for so many numbers an action.

    Episodes have one step, so the discount is of no use; the learning rate falls
    linearly to zero, because the last tenths of a degree drown in a constant one.
    """
    off_policy = {
        "learning_rate": _falling(1e-3),
        "buffer_size": settings.episodes,
        "learning_starts": 32 * settings.num_envs,
        "batch_size": 256,
        "train_freq": 1,
        "gradient_steps": settings.num_envs,
        "gamma": 0.0,
        "policy_kwargs": {"net_arch": [64, 64]},
    }
    return {
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
    }[settings.algorithm]


def train(
    task_kwargs: dict[str, Any],
    settings: Training,
    *,
    at: tuple[int, ...] = (),
    log: str | None = None,
    checkpoint: Path | None = None,
    progress: Progress | None = None,
) -> list[tuple[int, RLTuner]]:
    """Train an agent and return it, with snapshots on the way.

    Parameters
    ----------
    task_kwargs : dict
        Keyword arguments of the environment; ``visible="speed"`` makes the speed a feature,
        ``nonlinear=True`` records on saturating tyres.
    at : tuple of int
        Numbers of episodes after which a snapshot is taken; the end always is one.
        Those that a resumed training already has behind it are left out.
    log : str, optional
        Folder for TensorBoard.
    checkpoint : Path, optional
        Stable-Baselines3 zip written at every snapshot and resumed from if it is there,
        with the replay buffer, the averaged actor and what it was made for beside it.  Such
        files hold pickles, which can run code: resume from your own only.

    Returns
    -------
    list of (episodes, RLTuner)
    """
    return of_vehicles(task_kwargs, settings, log, checkpoint).learn(at, progress)


def train_plant(
    plant: Plant | str,
    settings: Training,
    *,
    log: str | None = None,
    checkpoint: Path | None = None,
    calibration: int = CALIBRATION,
    progress: Progress | None = None,
) -> PlantTuner:
    """Train an agent in ``yawrate/PlantFeatures-v0`` and calibrate its intervals.

    Parameters
    ----------
    plant : Plant or str
        The plant, or where it is found: ``"module:attribute"``.
    log, checkpoint
        As for `train`; the checkpoint is written ten times on the way.
    calibration : int
        Episodes that calibrate the intervals; 0 leaves those of a normal error.
    """
    check_calibration(calibration)
    run = of_plant(described(plant), settings, log, checkpoint)
    at = () if checkpoint is None else tenths(settings.episodes)
    (*_, (_, tuner)) = run.learn(at, progress)
    if calibration:
        calibrate(tuner, calibration, settings.seed, progress)
    return tuner


def tenths(episodes: int) -> tuple[int, ...]:
    """When a training writes its checkpoint, the end excepted."""
    step = max(episodes // 10, 1)
    return tuple(range(step, episodes, step))


def of_vehicles(
    task_kwargs: dict[str, Any], settings: Training, log: str | None, checkpoint: Path | None
) -> "Run[RLTuner]":
    """A run for vehicles; arguments as for `train`."""
    one = base_env(**task_kwargs)
    if one.visible == "context" or one.decimate != 1:
        raise ValueError(
            f"visible = {one.visible!r}, decimate = {one.decimate}: a tuner gets whole "
            "recordings without the truth. Use visible='episode' or 'speed', decimate=1."
        )
    env, features, _ = _environment(FEATURES_ID, settings, task_kwargs)

    def made(actor: Actor, training: dict[str, Any]) -> RLTuner:
        return RLTuner(one.task, features, VISIBLE[one.visible], actor, training)

    seen = {"visible": one.visible, "nonlinear": isinstance(one, PITuningNonlinearEnv)}
    origin = _origin(yaw_rate(one.task), settings, features, seen)
    return Run(env, made, settings, log, checkpoint, origin)


def of_plant(
    plant: Plant, settings: Training, log: str | None, checkpoint: Path | None
) -> "Run[PlantTuner]":
    """A run for any plant; arguments as for `train_plant`."""
    env, features, actions = _environment(PLANT_FEATURES_ID, settings, {"plant": plant})
    around = features.mean, features.scale, actions.low, actions.high
    black_box = functions_for(plant)

    def made(actor: Actor, training: dict[str, Any]) -> PlantTuner:
        stages = Stages(features.compressor, Agent(actor, *around))
        return PlantTuner(plant, stages, black_box, {"name": "rl", **training})

    return Run(env, made, settings, log, checkpoint, _origin(plant, settings, features))


def _origin(
    plant: Plant, settings: Training, features: FeatureMap, seen: dict[str, Any] | None = None
) -> Origin:
    """What a checkpoint says that it was made for."""
    first_stage = json.loads(json.dumps(described_stage(features.compressor)))
    return Origin(
        plant, {"algorithm": settings.algorithm, "compressor": first_stage, **(seen or {})}
    )


def _environment(
    name: str, settings: Training, kwargs: dict[str, Any]
) -> tuple[Any, FeatureMap, ActionMap]:
    """Episodes in a batch, and what an agent sees and does in them."""
    compressor, count = settings.compressor, settings.num_envs
    env: Any = gymnasium.make_vec(name, num_envs=count, compressor=compressor, **kwargs)
    return env, env.env.map, env.map


class Run(Generic[Made]):
    """One training run, in parts.

    Parameters
    ----------
    env : VectorEnv
        One of the two environments of features, native batch.
    made : callable
        The actor and how it was trained to a tuner.
    settings, log, checkpoint
        As for `train`.
    origin : Origin
        What a checkpoint must have been made for.
    """

    def __init__(
        self,
        env: Any,
        made: Maker[Made],
        settings: Training,
        log: str | None,
        checkpoint: Path | None,
        origin: Origin,
    ) -> None:
        self.settings, self.checkpoint, self.made = settings, checkpoint, made
        self.origin = origin
        if checkpoint is not None:
            check_folder(checkpoint.parent)
        self.env = Sb3VecEnv(env)
        self.average = _Average()
        if checkpoint is not None and checkpoint.exists():
            self.model = self._resumed(checkpoint)
        else:
            self.model = CLASSES[settings.algorithm](
                "MlpPolicy", self.env, seed=settings.seed, tensorboard_log=log, device="cpu",
                **hyperparameters(settings, env.single_action_space.shape[0]),
            )  # fmt: skip
        # The model has just seeded the environments with `seed`, `seed + 1`, ..., most of
        # which the next seed's run would have too, and a resumed run for a second time.
        self.env.seed(1_000_000 * (settings.seed + 1) + self.model.num_timesteps)

    def learn(self, at: tuple[int, ...], progress: Progress | None) -> list[tuple[int, Made]]:
        """Train to the end; the tuners after `at` and all episodes."""
        follower = _Follower(self, at, progress)
        left = self.settings.episodes - self.model.num_timesteps
        if left > 0:
            with threads(1):
                self.model.learn(left, follower, log_interval=100, reset_num_timesteps=False)
        return [*follower.taken, (self.model.num_timesteps, self.tuner())]

    def save(self) -> None:
        """Write the checkpoint, if one is wanted."""
        if self.checkpoint is None:
            return
        self.origin.write(_beside(self.checkpoint, "origin"))
        with replacing(self.checkpoint) as file:
            self.model.save(file)
        with replacing(_beside(self.checkpoint, "average.pt")) as file:
            torch.save((self.average.weights, self.average.batches), file)
        if isinstance(self.model, OffPolicyAlgorithm):
            with replacing(_beside(self.checkpoint, "buffer.pkl")) as file:
                self.model.save_replay_buffer(file)

    def _resumed(self, checkpoint: Path) -> BaseAlgorithm:
        try:
            self.origin.check(_beside(checkpoint, "origin"))
            model = CLASSES[self.settings.algorithm].load(checkpoint, env=self.env, device="cpu")
        except Exception as error:  # whatever a foreign zip makes Stable-Baselines3 raise
            raise ValueError(
                f"{checkpoint} is no checkpoint of {self.settings.algorithm} on "
                f"{self.settings.compressor} features ({error}). Resume with the settings that "
                "it was written with, or name another file."
            ) from error
        average, buffer = (_beside(checkpoint, name) for name in ("average.pt", "buffer.pkl"))
        if average.exists():
            self.average = _Average(*torch.load(average, weights_only=True))
        if isinstance(model, OffPolicyAlgorithm) and buffer.exists():
            model.load_replay_buffer(buffer)
        return model

    def tuner(self) -> Made:
        """The averaged actor as it is now."""
        training = {
            "algorithm": self.settings.algorithm,
            "episodes": int(self.model.num_timesteps),
            "num_envs": self.settings.num_envs,
            "seed": self.settings.seed,
        }
        return self.made(_actor(self.model, self.average.weights), training)


@dataclass
class _Average:
    """The actor's weights, averaged over the last couple of hundred batches."""

    weights: dict[str, torch.Tensor] = field(default_factory=dict)
    batches: int = 0

    def update(self, module: torch.nn.Module) -> None:
        self.batches += 1
        keep = min(_AVERAGING, max(0.0, 1 - 10 / self.batches))  # the last tenth, early on
        for name, value in module.state_dict().items():
            old = self.weights.get(name, value)
            self.weights[name] = old + (1 - keep) * (value - old)


class _Follower(BaseCallback):
    """Averages the actor, takes snapshots and reports progress."""

    def __init__(self, run: Run[Any], at: tuple[int, ...], progress: Progress | None) -> None:
        super().__init__()
        self.run, self.progress = run, progress
        behind = run.model.num_timesteps
        self.due = sorted(a for a in at if behind < a < run.settings.episodes)
        self.taken: list[tuple[int, Any]] = []

    def _on_step(self) -> bool:
        self.run.average.update(_actor_module(self.model))
        while self.due and self.num_timesteps >= self.due[0]:
            self.taken.append((self.due.pop(0), self.run.tuner()))
            self.run.save()
        if self.progress is not None:
            whole = self.run.settings.episodes
            self.progress("training rl", min(self.num_timesteps, whole), whole)
        return True

    def _on_training_end(self) -> None:
        self.run.save()


def _beside(checkpoint: Path, suffix: str) -> Path:
    return checkpoint.with_suffix(f".{suffix}")


def _falling(start: float) -> Any:
    def rate(remaining: float) -> float:
        return start * max(remaining, 0.0)

    return rate


def _actor_module(model: BaseAlgorithm) -> torch.nn.Module:
    if isinstance(model, PPO):
        return model.policy
    actor: Any = model.policy.actor
    return actor  # type: ignore[no-any-return]


def _actor(model: BaseAlgorithm, state: dict[str, torch.Tensor]) -> Actor:
    """The deterministic policy's layers, from averaged weights."""
    if isinstance(model, SAC):
        prefixes, hidden, squashed = ["latent_pi.", "mu."], "relu", True
    elif isinstance(model, TD3):
        prefixes, hidden, squashed = ["mu."], "relu", True
    else:
        prefixes, hidden, squashed = ["mlp_extractor.policy_net.", "action_net."], "tanh", False
    values = state or _actor_module(model).state_dict()
    names = [n for p in prefixes for n in values if n.startswith(p) and n.endswith("weight")]
    layers = [
        tuple(
            np.asarray(values[n.replace("weight", part)].detach().numpy(), dtype=np.float64)
            for part in ("weight", "bias")
        )
        for n in names
    ]
    return Actor([(weight, bias) for weight, bias in layers], hidden, squashed)
