"""Evaluate tuners and policies on the same episodes: one row an episode and tuner."""

import csv
import io
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tuners.tuner.recording import Recording
from yawrate_env import validation
from yawrate_env.files import write_text
from yawrate_env.plant.episodes import BLOCK, Episodes, recorded
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]


class Policy(Protocol):
    """Answers recordings with gains: every tuner, and the players of `tuners.agents.policies`."""

    def act(self, recording: Recording) -> Array:
        """Gains (B, k) for B episodes."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """One tuner's gains on E episodes of a plant, and what they do.

    Attributes
    ----------
    tuner : str
        Its name.
    plant : Plant
        The plants' description.
    theta : NDArray
        (E, p) their parameters.
    gains : NDArray
        (E, k) the tuner's.
    metrics : NDArray
        (E, f) counted metrics, also of unstable loops where these are defined; ``nan`` elsewhere.
    stable : NDArray
        (E,) whether the loop is stable.
    seconds : NDArray
        (E,) from raw arrays to gains, the episode's share of its batch.
    """

    tuner: str
    plant: Plant
    theta: Array
    gains: Array
    metrics: Array
    stable: NDArray[np.bool_]
    seconds: Array

    @property
    def errors(self) -> Array:
        """Distances (E, f) of the metrics from their targets."""
        return np.asarray(self.metrics - self.plant.targets(self.theta))


def evaluate(
    tuners: Mapping[str, Policy],
    plant: Plant,
    name: str,
    *,
    episodes: int,
    seed: int,
    batch: int = 1,
    progress: Progress | None = None,
) -> list[Evaluation]:
    """Give every tuner the same episodes of a set.

    Parameters
    ----------
    name : str
        The set: ``train``, ``test``, ``extrapolation`` or ``calibration``.
    batch : int
        How many episodes a tuner gets at a time; 1 measures what one answer takes.
    progress : callable, optional
        Called with how many of the (episode, tuner) pairs are done, and of how many.
    """
    validation.count("episodes", episodes)
    validation.count("seed", seed, at_least=0)
    validation.count("batch", batch)
    parts: dict[str, list[Evaluation]] = {tuner: [] for tuner in tuners}
    done, total = 0, episodes * len(tuners)
    for block in pieces(plant, name, seed, episodes, batch):
        for tuner, policy in tuners.items():
            warm = bool(parts[tuner])
            parts[tuner].append(_part(tuner, policy, plant, block, batch, warm=warm))
            done += len(block)
            if progress is not None:
                progress(done, total)
    return [_joined(part) for part in parts.values()]


def write_csv(path: str | os.PathLike[str], evaluations: Sequence[Evaluation]) -> None:
    """Write one row an episode and tuner, completely or not at all.

    Columns are ``tuner, episode``, the plant's parameters, its gains, its counted metrics,
    ``stable`` and ``seconds``.
    """
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(columns(evaluations[0].plant))
    for e in evaluations:
        writer.writerows(_rows(e))
    write_text(path, text.getvalue())


def columns(plant: Plant) -> tuple[str, ...]:
    """Names of the columns that `write_csv` writes."""
    metrics = (split(name)[0] for name in plant.counted)
    return "tuner", "episode", *plant.prior, *plant.gains, *metrics, "stable", "seconds"


def pieces(plant: Plant, name: str, seed: int, count: int, batch: int) -> Iterator[Episodes]:
    """Episodes of a set in pieces as large as a tuner's batch, or larger."""
    size = max(2 * BLOCK, batch)
    for first in range(0, count, size):
        yield recorded(plant, name, seed, min(size, count - first), first=first)


def _part(
    name: str, policy: Policy, plant: Plant, block: Episodes, batch: int, *, warm: bool
) -> Evaluation:
    count, k = len(block), len(plant.gains)
    recording = Recording(block.u, block.y, plant.Ts, block.theta)
    if not warm:
        policy.act(recording.part(slice(0, batch)))  # compile before the clock runs
    gains, seconds = np.empty((count, k)), np.empty(count)
    for i in range(0, count, batch):
        part = slice(i, min(i + batch, count))
        start = time.perf_counter()
        gains[part] = policy.act(recording.part(part))
        seconds[part] = (time.perf_counter() - start) / len(gains[part])
    metrics, stable = plant.evaluation(block.theta, gains)
    chosen = [list(plant.metrics).index(metric) for metric in plant.counted]
    return Evaluation(name, plant, block.theta, gains, metrics[:, chosen], stable, seconds)


def _joined(parts: Sequence[Evaluation]) -> Evaluation:
    """One tuner's parts in a row; the plant is that of all."""

    def joined(name: str) -> NDArray[Any]:
        return np.concatenate([getattr(part, name) for part in parts])

    return Evaluation(
        parts[0].tuner,
        parts[0].plant,
        joined("theta"),
        joined("gains"),
        joined("metrics"),
        joined("stable"),
        joined("seconds"),
    )


def _rows(e: Evaluation) -> list[tuple[object, ...]]:
    numbers = np.concatenate([e.theta, e.gains, e.metrics], axis=1)
    return [
        (e.tuner, episode, *(f"{v:.12g}" for v in values), bool(stable), f"{seconds:.3e}")
        for episode, (values, stable, seconds) in enumerate(
            zip(numbers, e.stable, e.seconds, strict=True)
        )
    ]
