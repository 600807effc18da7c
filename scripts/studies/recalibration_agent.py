"""Agents that learned `yawrate/PIRecalibration-v0` from rewards, as rungs of the ladder.

All training is in the native batch environment, on drives of other seeds than the test's.  Like
every rung they start with gains that are right; they keep them until a window is over.
"""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.recalibration import Progress, Row, begun, interface, ride, row
from tuners.agents.recalibrator import Recalibrator
from yawrate_env.env.interface import Observation
from yawrate_env.env.recalibration_env import PIRecalibrationVectorEnv
from yawrate_env.env.recalibration_interface import RecalibrationInterface
from yawrate_env.vehicle.drive_conditions import Window
from yawrate_env.vehicle.drives import Course, Driven, Drives

Array = NDArray[np.float64]

NAMES = {True: "agent, seed {seed}", False: "agent without memory, seed {seed}"}
_BATCH = 200  # drives at a time


@dataclass(slots=True, eq=False)
class Acting:
    """A policy as a rung.

    Attributes
    ----------
    policy : object
        With Stable-Baselines3's ``predict``.
    """

    policy: Any
    made: RecalibrationInterface
    start: Course
    driven: Driven | None = None
    state: Any = None

    def gains(self, course: Course, coming: Window) -> Array:
        """The policy's; before the first window those of the start."""
        if self.driven is None:
            return self.start.gains
        obs = self.made.observation(self.driven.estimate, self.driven.gains, coming)
        return self.chosen(obs)

    def chosen(self, obs: Observation) -> Array:
        """Gains of the policy's actions; ``nan`` keeps those in effect."""
        starts = np.full(len(obs), self.state is None)
        actions, self.state = self.policy.predict(
            obs, state=self.state, episode_start=starts, deterministic=True
        )
        taken = actions[:, 2:3] > 0
        return np.where(taken, self.made.chosen(actions), np.nan)

    def learn(self, before: Course, driven: Driven) -> None:
        """Observe the window."""
        self.driven = driven


def trained(windows: int, seed: int, remembers: bool) -> Recalibrator:
    """An agent that learned from so many windows."""
    envs = PIRecalibrationVectorEnv(min(_BATCH, windows))
    return Recalibrator(seed=seed, remembers=remembers).learn(envs, windows)


def rows(count: int, windows: int, seeds: int, seed: int, progress: Progress) -> list[Row]:
    """Agents of several seeds, and one without memory, on `count` drives of a test."""
    usual, found = interface(Drives.of()), []
    start = begun(usual.drives, seed, count)
    todo = [*((True, own) for own in range(seeds)), (False, 0)]
    for done, (remembers, own) in enumerate(todo, 1):
        began = time.perf_counter()
        agent = trained(windows, own, remembers)
        seconds = time.perf_counter() - began
        name = NAMES[remembers].format(seed=own)
        ridden = ride(usual, Acting(agent, usual, start), start, seed)
        found.append({**row(name, ridden), "seconds": seconds})
        progress("agents", done, len(todo))
    return found
