"""Training data: episodes of a seed to features and targets, in bounded memory."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners import coordinates
from tuners.compressors import Compressor, conditioned
from yawrate_env.batch import concatenate, take
from yawrate_env.contexts import ContextSet
from yawrate_env.design import Design, Status
from yawrate_env.episode import record
from yawrate_env.judge import Judge
from yawrate_env.task import Task
from yawrate_env.vehicle import Context

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

TRAINING_SHARE = 0.8

_BLOCK = 128


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
    features: Array
    usable: NDArray[np.bool_]
    oracle: Design

    def __len__(self) -> int:
        return len(self.features)

    def targets(self, task: Task, kind: str) -> Array:
        """(m, 2) in the given coordinates."""
        return coordinates.encode(self.oracle.kp, self.oracle.Ti, task.target, kind)


def simulated(
    task: Task,
    contexts: ContextSet,
    seed: int,
    first: int,
    count: int,
    compressor: Compressor,
    repeat: int = 0,
) -> Iterator[tuple[Dataset, Array, Array]]:
    """Episodes ``first`` to ``first + count`` of a seed, block by block.

    The blocks start at multiples of their size and are computed whole, whatever part of
    them is asked for: BLAS sums in another order when a batch is of another size, and
    the last bits of a row would depend on where a data set was cut.

    Yields
    ------
    rows : Dataset
        The block's episodes, compressed.
    u : (1, N) or (B, N) float64
        Steering command [rad].
    y : (B, N) float64
        Measured yaw rate [rad/s].
    """
    stop = first + count
    for start in range(first - first % _BLOCK, stop, _BLOCK):
        draw = contexts.draw(task.prior, seed, start, _BLOCK, repeat)
        u, measured = record(task, draw)
        y = np.asarray(measured, dtype=np.float64)
        features, usable = compressor(u, y, task.experiment.Ts)
        features = conditioned(features, task.prior, draw.context.v_x)
        oracle = Judge.of(task, draw.context).oracle()
        usable &= oracle.status == Status.OK
        vehicle = np.arange(start, start + _BLOCK)
        asked = slice(max(first - start, 0), stop - start)
        rows = take(Dataset(vehicle, draw.context, features, usable, oracle), asked)
        yield rows, u if len(u) == 1 else u[asked], y[asked]


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
    parts: list[Dataset] = []
    done, of = 0, episodes * noise_draws
    for repeat in range(noise_draws):
        for rows, _, _ in simulated(task, contexts, seed, 0, episodes, compressor, repeat):
            parts.append(rows)
            done += len(rows)
            if progress is not None:
                progress(done, of)
    return concatenate(parts)


def trains(vehicles: int, seed: int) -> NDArray[np.bool_]:
    """(vehicles,) which of them train; the rest validate."""
    order = np.random.default_rng(seed).permutation(vehicles)
    chosen = np.zeros(vehicles, dtype=np.bool_)
    chosen[order[: round(TRAINING_SHARE * vehicles)]] = True
    return chosen
