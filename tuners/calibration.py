"""Split conformal calibration of a tuner's intervals, on episodes that nothing learned from."""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from tuners.recording import Recording
from tuners.trust import Assessment, calibrated
from tuners.tuner import Tuner
from yawrate_env import validation
from yawrate_env.contexts import CONTEXT_SETS, ContextSet
from yawrate_env.episode import record
from yawrate_env.judge import Judge
from yawrate_env.task import Task

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

EPISODES = 5000
_CHUNK = 100


def calibrate(
    tuner: Tuner, *, episodes: int = EPISODES, seed: int = 0, progress: Progress | None = None
) -> None:
    """Set the tuner's `calibration` from `episodes` of the ``calibration`` set."""
    validation.count("episodes", episodes, at_least=100, remedy="Simulate more.")
    parts = []
    for found, actual, done in assessed(tuner, CONTEXT_SETS["calibration"], episodes, seed):
        parts.append(np.stack([found.margins, found.spread, actual]))
        if progress is not None:
            progress(done, episodes)
    predicted, spread, actual = np.concatenate(parts, axis=1)
    tuner.calibration = calibrated(predicted, spread, actual, seed)


def assessed(
    tuner: Tuner, contexts: ContextSet, episodes: int, seed: int, task: Task | None = None
) -> Iterator[tuple[Assessment, Array, int]]:
    """Tune and assess episodes as `Tuner.tune` does, in bounded memory.

    Parameters
    ----------
    task : Task, optional
        Where the episodes come from, if not from the tuner's own task.

    Yields
    ------
    found : Assessment
    actual : (B, 2) float64
        Phase margin [deg] and crossover [Hz] with the true vehicles; ``nan`` if unstable.
    done : int
        Episodes so far.
    """
    task = task or tuner.task
    for first in range(0, episodes, _CHUNK):
        draw = contexts.draw(task.prior, seed, first, min(_CHUNK, episodes - first))
        u, y = record(task, draw)
        recording = Recording(u, np.asarray(y), task.experiment.Ts, draw.context.v_x, draw.context)
        design, found = tuner.assess(recording)
        verdict = Judge.of(task, draw.context)(design.kp, design.Ti)
        margins = np.stack([verdict.margins.phase_margin, verdict.margins.crossover], axis=1)
        yield found, np.where(verdict.stable[:, None], margins, np.nan), first + len(draw)
