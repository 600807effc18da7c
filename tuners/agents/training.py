"""Train an agent to tune a plant, from rewards alone.

An agent is trained in the plant's environment of features: standardised features in, the
coordinates of a controller out, one step an episode.  It never sees the design rule's gains.  What
is kept is the actor, averaged where the algorithm lets it wander, as arrays: the second stage of a
`Tuner`, which needs neither Stable-Baselines3 nor torch.
"""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback

from tuners.agents.actors import (
    ALGORITHMS,
    AVERAGED,
    Average,
    actor_module,
    actor_of,
    hyperparameters,
)
from tuners.agents.checkpoint import Checkpoint, Origin
from tuners.agents.sb3_vec_env import Sb3VecEnv
from tuners.agents.settings import Training
from tuners.agents.wrappers import FeatureVectorObservation, UnitVectorAction
from tuners.features import settings_of
from tuners.learners.actor import Agent
from tuners.learners.threads import threads
from tuners.tuner.stages import Stages
from tuners.tuner.training import CALIBRATION, calibrate, check_calibration
from tuners.tuner.tuner import Tuner
from yawrate_env.env.vector_env import plant_vector_env
from yawrate_env.plant.entry import find
from yawrate_env.plant.plant import Plant

Progress = Callable[[str, int, int], None]


def train(
    training: Training,
    plant: Plant | str,
    *,
    log: str | None = None,
    checkpoint: Path | None = None,
    calibration: int = CALIBRATION,
    progress: Progress | None = None,
) -> Tuner:
    """Train an agent and calibrate the tuner's intervals.

    Parameters
    ----------
    training : Training
        How.
    plant : Plant or str
        The plant, or its entry ``"module:attribute"``.
    log : str, optional
        Folder for TensorBoard.
    checkpoint : Path, optional
        Stable-Baselines3 zip, written ten times and resumed from if it exists; replay buffer,
        averaged actor and origin are beside it.  Such files hold pickles, which can run code:
        resume from your own only.
    calibration : int
        Episodes that calibrate the intervals; 0 leaves those of a normal error.
    progress : callable, optional
        Called with the stage's name, how far it is, and how far it goes.
    """
    check_calibration(calibration)
    step = max(training.episodes // 10, 1)
    at = () if checkpoint is None else range(step, training.episodes, step)
    (*_, (_, tuner)) = snapshots(
        training, plant, at, log=log, checkpoint=checkpoint, progress=progress
    )
    if calibration:
        calibrate(tuner, calibration, training.seed, progress)
    return tuner


def snapshots(
    training: Training,
    plant: Plant | str,
    at: Iterable[int] = (),
    *,
    log: str | None = None,
    checkpoint: Path | None = None,
    progress: Progress | None = None,
) -> list[tuple[int, Tuner]]:
    """Train an agent and return it as it was after some numbers of episodes.

    Parameters
    ----------
    at : iterable of int
        Numbers of episodes; the end is always added.  A checkpoint is written at each; those
        that a resumed training is already past are left out.

    Returns
    -------
    list of (episodes, Tuner)
    """
    return Run(training, find(plant), log, checkpoint).learn(at, progress)


class Run:
    """One training run.

    Parameters
    ----------
    training, plant, log, checkpoint
        As for `train`.
    """

    def __init__(
        self,
        training: Training,
        plant: Plant,
        log: str | None = None,
        checkpoint: Path | None = None,
    ) -> None:
        self.training, self.plant = training, plant
        observed = _features(training, plant)
        chosen = UnitVectorAction(observed)
        self.features = observed.map.features
        self.scaling = observed.map.mean, observed.map.scale, chosen.map.low, chosen.map.high
        self.env = Sb3VecEnv(chosen)
        self.average = Average()
        settings = {"algorithm": training.algorithm, "features": settings_of(self.features)}
        self.checkpoint = checkpoint and Checkpoint(checkpoint, Origin(plant, settings))
        if self.checkpoint and self.checkpoint.path.exists():
            self.model, self.average = self.checkpoint.read(self.env)
        else:
            self.model = ALGORITHMS[training.algorithm](
                "MlpPolicy", self.env, seed=training.seed, tensorboard_log=log, device="cpu",
                **hyperparameters(training, len(chosen.map.low)),
            )  # fmt: skip
        # The model has just seeded the environments with `seed`, `seed + 1`, ..., most of
        # which the next seed's run would have too, and a resumed run for a second time.
        self.env.seed(1_000_000 * (training.seed + 1) + self.model.num_timesteps)

    def learn(
        self, at: Iterable[int] = (), progress: Progress | None = None
    ) -> list[tuple[int, Tuner]]:
        """Train to the end; the tuners after `at` and all episodes."""
        follower = _Follower(self, at, progress)
        left = self.training.episodes - self.model.num_timesteps
        if left > 0:
            with threads(1):
                self.model.learn(
                    left, follower, log_interval=self.log_interval, reset_num_timesteps=False
                )
        return [*follower.taken, (self.model.num_timesteps, self.tuner())]

    @property
    def log_interval(self) -> int:
        """In batches of episodes, or for ``naf`` in fits."""
        return 100 if self.training.algorithm in AVERAGED else 1

    def save(self) -> None:
        """Write the checkpoint, if there is one."""
        if self.checkpoint:
            self.checkpoint.write(self.model, self.average)

    def tuner(self) -> Tuner:
        """The averaged actor as it is now."""
        agent = Agent(actor_of(self.model, self.average.weights), *self.scaling)
        record = {
            "name": self.training.name,
            "algorithm": self.training.algorithm,
            "episodes": int(self.model.num_timesteps),
            "num_envs": self.training.batch,
            "seed": self.training.seed,
        }
        return Tuner(self.plant, Stages(self.features, agent), record)


class _Follower(BaseCallback):
    """Averages the actor, takes snapshots and reports progress."""

    def __init__(self, run: Run, at: Iterable[int], progress: Progress | None) -> None:
        super().__init__()
        self.run, self.progress = run, progress
        done = run.model.num_timesteps
        self.due = sorted(a for a in at if done < a < run.training.episodes)
        self.taken: list[tuple[int, Tuner]] = []

    def _on_step(self) -> bool:
        if self.run.training.algorithm in AVERAGED:
            self.run.average.update(actor_module(self.model))
        while self.due and self.num_timesteps >= self.due[0]:
            self.taken.append((self.due.pop(0), self.run.tuner()))
            self.run.save()
        if self.progress is not None:
            whole = self.run.training.episodes
            self.progress(
                f"training {self.run.training.name}", min(self.num_timesteps, whole), whole
            )
        return True

    def _on_training_end(self) -> None:
        self.run.save()


def _features(training: Training, plant: Plant) -> Any:
    """The plant's batch of episodes, observed as features."""
    batch, features = plant_vector_env(training.batch, plant=plant), training.features
    if isinstance(features, str):
        return FeatureVectorObservation(batch, features)
    settings = settings_of(features)
    return FeatureVectorObservation(batch, settings.pop("name"), **settings)
