"""Recorded episodes of the default vehicles, the same in every test that asks."""

from functools import cache
from pathlib import Path

import numpy as np

from tuners.tuner.recording import Recording
from yawrate_env.plant import episodes
from yawrate_env.vehicle.single_track import context_of
from yawrate_env.vehicle.task import Experiment, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

ROOT = Path(__file__).parents[1]


@cache
def recorded(count: int, experiment: Experiment = Experiment()) -> Recording:  # noqa: B008, frozen
    """The first recordings of the test set, with the truth; read-only."""
    plant = yaw_rate(Task(experiment=experiment))
    found = episodes.recorded(plant, "test", 0, count)
    for array in (found.u, found.y, found.theta):
        array.setflags(write=False)
    return Recording(found.u, found.y, experiment.Ts, found.theta)


def vehicles(recording: Recording):
    """The recordings' true vehicles, as a context."""
    return context_of(recording.known)


def observations(recording: Recording) -> np.ndarray:
    """As the environment shows them, (B, 2, N) float32."""
    u = np.broadcast_to(recording.u, recording.y.shape)
    return np.stack([u, recording.y], axis=1).astype(np.float32)
