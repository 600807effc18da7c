"""Recorded episodes of the default task, the same in every test that asks."""

from functools import cache
from pathlib import Path

import numpy as np

from tuners.tuner.recording import Recording
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.episode import Draw, record
from yawrate_env.vehicle.task import Experiment, Prior, Task

ROOT = Path(__file__).parents[1]


@cache
def drawn(count: int, prior: Prior = Prior()) -> Draw:  # noqa: B008, frozen
    """The first episodes of the test set."""
    return CONTEXT_SETS["test"].draw(prior, 0, 0, count)


@cache
def recorded(count: int, experiment: Experiment = Experiment()) -> Recording:  # noqa: B008, frozen
    """Their recordings, with the truth beside them; read-only."""
    draw = drawn(count)
    u, y = record(Task(experiment=experiment), draw)
    for array in (u, y):
        array.setflags(write=False)
    return Recording(u, y, experiment.Ts, draw.context.v_x, draw.context)


def observations(recording: Recording) -> np.ndarray:
    """As the environment shows them, (B, 2, N) float32."""
    u = np.broadcast_to(recording.u, recording.y.shape)
    return np.stack([u, recording.y], axis=1).astype(np.float32)
