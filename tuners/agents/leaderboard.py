"""Score a policy on an environment, as one file of a leaderboard.

    from tuners.agents.leaderboard import score

    score("yawrate/PITuning-v0", "mine", {0: policy}, learned_from="...").save("leaderboard")

All policies get the same episodes: those of ``reset(seed=k)`` for k from 0 on, in native batches.
"""

import json
import platform
import re
import subprocess
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

import gymnasium
import numpy as np
from numpy.typing import NDArray

import yawrate_env
from tuners.agents.policies import Predictor
from yawrate_env import validation
from yawrate_env.files import write_text
from yawrate_env.plant.reward import UNSTABLE

Array = NDArray[np.float64]

PROTOCOL = 1
"""Version; whatever changes a score makes a new one."""

EPISODES = {yawrate_env.ENV_ID: 1500, yawrate_env.FEATURES_ID: 1500,
            yawrate_env.RECALIBRATION_ID: 400}  # fmt: skip
"""How many count, of each environment that has a leaderboard."""

_STEPS = {yawrate_env.RECALIBRATION_ID: 50}  # of an episode; otherwise one
_BATCH = 256
_RESAMPLES = 1000
_PACKAGES = "yawrate", "gymnasium", "numpy"


@dataclass(frozen=True, slots=True)
class Run:
    """The policy of one training seed.

    Attributes
    ----------
    seed : int
        Of its training.
    mean, low, high : float
        Return of an episode, and its 95 % bootstrap interval over episodes.  Windows that an
        unstable loop leaves undriven count as unstable: to end a drive must not pay.
    unstable : float
        Share of the episodes with an unstable loop.
    cost : float
        Share of the steps with a cost: unstable, or a phase margin below 45 deg.
    seconds : float
        Wall time of the policy's answers.
    """

    seed: int
    mean: float
    low: float
    high: float
    unstable: float
    cost: float
    seconds: float


@dataclass(frozen=True, slots=True)
class Entry:
    """A row of the leaderboard.

    Attributes
    ----------
    env, name : str
        The environment, and what the row is called.
    learned_from : str
        What was seen, and what was known beforehand, in words.
    training : float or None
        Wall time of one training [s], as told.
    episodes : int
        On which it was scored; fewer than `EPISODES` are a trial.
    runs : tuple of Run
        One a training seed.
    versions : dict
        Of the packages and Python.
    commit : str or None
        Of the working folder, where it is a checkout.
    protocol : int
        `PROTOCOL`.
    """

    env: str
    name: str
    learned_from: str
    training: float | None
    episodes: int
    runs: tuple[Run, ...]
    versions: dict[str, str]
    commit: str | None
    protocol: int = PROTOCOL

    @property
    def file(self) -> str:
        """Name of its file."""
        return f"{self.env.partition('/')[2]}.{self.name}.json"

    def save(self, folder: str | Path) -> Path:
        """Write its file into a folder, which is made if absent."""
        path = Path(folder) / self.file
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps(asdict(self), indent=1, allow_nan=False) + "\n")
        return path

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a file."""
        found = json.loads(Path(path).read_text())
        return cls(**found | {"runs": tuple(Run(**run) for run in found["runs"])})


def score(
    env: str,
    name: str,
    policies: Mapping[int, Predictor],
    *,
    learned_from: str,
    training: float | None = None,
    episodes: int | None = None,
) -> Entry:
    """Score policies of several training seeds.

    Parameters
    ----------
    env : str
        One of `EPISODES`.
    name : str
        Of the row: letters, digits, dashes.
    policies : dict
        Training seed to an object with Stable-Baselines3's
        ``predict(obs, state=, episode_start=, deterministic=True)``.
    learned_from : str
        What was seen, and what was known beforehand, in words.
    training : float, optional
        Wall time of one training [s].
    episodes : int, optional
        Fewer, for a trial.
    """
    validation.one_of("env", env, tuple(EPISODES))
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]*", name):
        raise ValueError(f"name = {name!r} names a file. Give letters, digits and dashes.")
    if not policies:
        raise ValueError("policies = {} is empty. Give {seed: policy}.")
    count = validation.count("episodes", episodes or EPISODES[env], at_least=1)
    runs = tuple(_run(env, seed, policy, count) for seed, policy in policies.items())
    versions = {package: version(package) for package in _PACKAGES}
    versions["python"] = platform.python_version()
    return Entry(env, name, learned_from, training, count, runs, versions, _commit())


def _run(env: str, seed: int, policy: Predictor, episodes: int) -> Run:
    blocks = [_episodes(env, policy, range(first, min(first + _BATCH, episodes)))
              for first in range(0, episodes, _BATCH)]  # fmt: skip
    returns, unstable, costs, steps, seconds = (
        np.concatenate(column) for column in zip(*blocks, strict=True)
    )
    chosen = np.random.default_rng(0).integers(0, episodes, (_RESAMPLES, episodes))
    low, high = np.quantile(returns[chosen].mean(axis=1), [0.025, 0.975]).tolist()
    cost = float(costs.sum() / steps.sum())
    mean, lost = float(returns.mean()), float(unstable.mean())
    return Run(seed, mean, low, high, lost, cost, float(seconds.sum()))


def _episodes(env: str, policy: Predictor, seeds: range) -> tuple[Array, ...]:
    """Return, whether unstable, costs, steps (B,) of one episode a seed; seconds (1,)."""
    envs: Any = gymnasium.make_vec(env, num_envs=len(seeds))
    obs, _ = envs.reset(seed=list(seeds))
    B, state, seconds = len(seeds), None, 0.0
    returns, unstable, costs, steps = np.zeros((4, B))
    going, starts = np.ones(B, np.bool_), np.ones(B, np.bool_)
    while going.any():
        began = time.perf_counter()
        actions, state = policy.predict(obs, state=state, episode_start=starts, deterministic=True)
        seconds += time.perf_counter() - began
        obs, rewards, terminated, truncated, info = envs.step(np.asarray(actions))
        starts = terminated | truncated
        final = info.get("final_info", {})
        for name, total in (("cost", costs), ("stable", unstable)):
            values = np.where(starts, final.get(name, 0.0), info.get(name, 0.0))
            total += going * (values if name == "cost" else 1 - values)
        returns += np.where(going, rewards, 0.0)
        steps += going
        going &= ~starts
    envs.close()
    returns += UNSTABLE * unstable * (_STEPS.get(env, 1) - steps)
    return returns, unstable, costs, steps, np.array([seconds])


def _commit() -> str | None:
    try:
        found = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True,
                               text=True, timeout=5, check=True)  # fmt: skip
    except (OSError, subprocess.SubprocessError):
        return None
    return found.stdout.strip() or None
