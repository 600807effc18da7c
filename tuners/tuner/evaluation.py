"""The same episodes to every tuner or policy, one judge, one row an episode and tuner."""

import csv
import io
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tuners.tuner.recording import Recording
from yawrate_env import validation
from yawrate_env.batch import concatenate
from yawrate_env.files import write_text
from yawrate_env.vehicle.contexts import ContextSet
from yawrate_env.vehicle.episode import loops, record
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Task

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

COLUMNS = (
    "tuner",
    "episode",
    "mu_s",
    "M_delta",
    "v_x",
    "kp",
    "Ti",
    "phase_margin",
    "crossover",
    "stable",
    "seconds",
)

_CHUNK = 256


class Policy(Protocol):
    """Whatever answers recordings with gains: every tuner, and players of `agents.policies`."""

    def act(self, recording: Recording) -> Array:
        """(B, 2) of (kp, Ti) for B episodes."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """One tuner's gains on E episodes and what they do; arrays (E,).

    Attributes
    ----------
    tuner : str
        Its name.
    context : Context
        The vehicles.
    kp, Ti : NDArray
        Gains, and integral times [s].
    phase_margin, crossover : NDArray
        [deg] and [Hz]; ``nan`` where undefined.
    stable : NDArray
        Whether the loop is stable.
    seconds : NDArray
        From raw arrays to gains, the episode's share of its batch.
    """

    tuner: str
    context: Context
    kp: Array
    Ti: Array
    phase_margin: Array
    crossover: Array
    stable: NDArray[np.bool_]
    seconds: Array


def evaluate(
    tuners: Mapping[str, Policy],
    task: Task,
    contexts: ContextSet,
    *,
    episodes: int,
    seed: int,
    batch: int = 1,
    progress: Progress | None = None,
) -> list[Evaluation]:
    """Give every tuner the same `episodes` of a context set.

    Parameters
    ----------
    batch : int
        How many episodes a tuner gets at a time; 1 measures what one answer takes.
    progress : callable, optional
        Called with how many of the (episode, tuner) pairs are done, and of how many.
    """
    validation.count("episodes", episodes)
    validation.count("seed", seed, at_least=0)
    validation.count("batch", batch)
    parts: dict[str, list[Evaluation]] = {name: [] for name in tuners}
    done, total = 0, episodes * len(tuners)
    for first in range(0, episodes, max(_CHUNK, batch)):
        count = min(max(_CHUNK, batch), episodes - first)
        draw = contexts.draw(task.prior, seed, first, count)
        u, y = record(task, draw)
        recording = Recording(u, np.asarray(y), task.experiment.Ts, draw.context.v_x, draw.context)
        judge = loops(task, draw.context)
        for name, tuner in tuners.items():
            parts[name].append(_part(name, tuner, recording, judge, batch, warm=first > 0))
            done += count
            if progress is not None:
                progress(done, total)
    return [concatenate(part) for part in parts.values()]


def write_csv(path: str | os.PathLike[str], evaluations: Sequence[Evaluation]) -> None:
    """Write `COLUMNS`, one row an episode and tuner, completely or not at all."""
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(COLUMNS)
    for e in evaluations:
        writer.writerows(_rows(e))
    write_text(path, text.getvalue())


def _part(
    name: str, tuner: Policy, recording: Recording, judge: Loops, batch: int, *, warm: bool
) -> Evaluation:
    count = len(recording)
    if not warm:
        tuner.act(recording.part(slice(0, batch)))  # compile before the clock runs
    kp, Ti, seconds = np.empty(count), np.empty(count), np.empty(count)
    for i in range(0, count, batch):
        part = slice(i, min(i + batch, count))
        start = time.perf_counter()
        actions = tuner.act(recording.part(part))
        seconds[part] = (time.perf_counter() - start) / len(actions)
        kp[part], Ti[part] = actions.T
    verdict = judge.evaluate(kp, Ti)
    assert recording.context is not None
    return Evaluation(
        name,
        recording.context,
        kp,
        Ti,
        verdict.margins.phase_margin,
        verdict.margins.crossover,
        verdict.stable,
        seconds,
    )


def _rows(e: Evaluation) -> list[tuple[object, ...]]:
    c = e.context
    columns = (c.mu_s, c.M_delta, c.v_x, e.kp, e.Ti, e.phase_margin, e.crossover)
    return [
        (e.tuner, episode, *(f"{v:.12g}" for v in values), bool(stable), f"{seconds:.3e}")
        for episode, (*values, stable, seconds) in enumerate(
            zip(*columns, e.stable, e.seconds, strict=True)
        )
    ]
