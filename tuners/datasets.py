"""Training data: episodes of a seed to features and targets, in bounded memory."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners import coordinates
from tuners.compressors import Compressor
from yawrate_env.batch import concatenate
from yawrate_env.contexts import ContextSet
from yawrate_env.design import Design, Status
from yawrate_env.episode import record
from yawrate_env.judge import Judge
from yawrate_env.task import Task
from yawrate_env.vehicle import Context

Progress = Callable[[int, int], None]

_CHUNK = 256


@dataclass(frozen=True, slots=True, eq=False)
class Dataset:
    """Compressed episodes with what the design rule says of their vehicles.

    Attributes
    ----------
    vehicle : NDArray
        (m,) which vehicle a row is of; the rows of one differ by their noise alone.
    context : Context
        The vehicles.
    features : NDArray
        (m, n) float64.
    usable : NDArray
        (m,) whether the compression converged and the target is reachable.
    oracle : Design
        The design rule's gains.
    """

    vehicle: NDArray[np.int64]
    context: Context
    features: NDArray[np.float64]
    usable: NDArray[np.bool_]
    oracle: Design

    def __len__(self) -> int:
        return len(self.features)

    def targets(self, task: Task, kind: str) -> NDArray[np.float64]:
        """(m, 2) in the given coordinates."""
        return coordinates.encode(self.oracle.kp, self.oracle.Ti, task.target, kind)


def simulate_dataset(
    task: Task,
    contexts: ContextSet,
    episodes: int,
    seed: int,
    compressor: Compressor,
    *,
    noise_draws: int = 1,
    progress: Progress | None = None,
) -> Dataset:
    """Simulate and compress the first `episodes` of a context set's seed.

    Parameters
    ----------
    noise_draws : int
        Record every vehicle so many times, with fresh noise.
    """
    parts = []
    for repeat in range(noise_draws):
        for first in range(0, episodes, _CHUNK):
            count = min(_CHUNK, episodes - first)
            draw = contexts.draw(task.prior, seed, first, count, repeat)
            u, y = record(task, draw)
            features, usable = compressor(u, np.asarray(y, dtype=np.float64), task.experiment.Ts)
            oracle = Judge.of(task, draw.context).oracle()
            usable &= oracle.status == Status.OK
            vehicle = np.arange(first, first + count)
            parts.append(Dataset(vehicle, draw.context, features, usable, oracle))
            if progress is not None:
                progress(repeat * episodes + first + count, episodes * noise_draws)
    return concatenate(parts)
