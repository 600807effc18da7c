"""How many plant interactions does reinforcement learning need?  Learning curves.

Agents of several seeds and two-stage tuners are given the same numbers of simulated
episodes, and all are tested on the same ones.  Several runs are summed up by the
interquartile mean with a bootstrap interval over seeds (Agarwal et al., 2021).
"""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.agents import rl_tuner as rl
from tuners.agents import training as rl_training
from tuners.catalogue import UNTRAINED, from_file
from tuners.catalogue import train as train_two_stage
from tuners.tuner.evaluation import Evaluation, evaluate
from tuners.tuner.tuner import Tuner
from yawrate_env.files import write_text
from yawrate_env.plant.reward import margin_error
from yawrate_env.vehicle.contexts import CONTEXT_SETS
from yawrate_env.vehicle.task import Task

EPISODES = (500, 1000, 2000, 5000, 10_000, 20_000)
"""Sizes at which everybody is compared."""

TEST_EPISODES = 1500

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True)
class Score:
    """One tuner on the test episodes.

    Attributes
    ----------
    name : str
        Tuner or agent.
    episodes : int
        Simulated episodes that it learned from.
    seed : int
        Of its training.
    error : float
        Mean of the reward's scaled margin error.
    phase_margin, crossover : tuple of float
        Mean and standard deviation [deg], [Hz].
    unstable : int
        Unstable loops.
    seconds : float
        Wall time of the whole training, on one core; 0 where nothing was trained.
    """

    name: str
    episodes: int
    seed: int
    error: float
    phase_margin: tuple[float, float]
    crossover: tuple[float, float]
    unstable: int
    seconds: float = 0.0


def sizes(episodes: int) -> list[int]:
    """Those of `EPISODES` on the way to `episodes`, and the end."""
    return [n for n in EPISODES if n < episodes] + [episodes]


def agents(
    settings: rl.Training, folder: Path, progress: Progress | None = None
) -> dict[int, tuple[Path, float]]:
    """Train one agent with snapshots at `sizes`, or find it already in `folder`.

    Returns
    -------
    dict
        Episodes to (file, seconds of the whole training).
    """
    folder.mkdir(parents=True, exist_ok=True)
    stem = f"{settings.algorithm}-{settings.compressor}-{settings.seed}"
    clock = folder / f"{stem}.json"
    files = {n: folder / f"{stem}-{n}.tuner" for n in sizes(settings.episodes)}
    done = json.loads(clock.read_text()) if clock.exists() else {}
    if done != {**asdict(settings), "seconds": done.get("seconds")}:  # none, or another length
        start = time.perf_counter()
        snapshots = rl_training.train({}, settings, at=tuple(files), progress=progress)
        done = {"seconds": time.perf_counter() - start, **asdict(settings)}
        for path, (_, tuner) in zip(files.values(), snapshots, strict=True):
            tuner.save(path)
        write_text(clock, json.dumps(done))
    return {n: (path, done["seconds"]) for n, path in files.items()}


def score(e: Evaluation, task: Task, episodes: int, seed: int, seconds: float = 0.0) -> Score:
    """Sum up one evaluation."""
    errors = margin_error(e.phase_margin, e.crossover, task.target)
    return Score(
        e.tuner,
        episodes,
        seed,
        float(np.mean(errors)),
        (float(e.phase_margin.mean()), float(e.phase_margin.std())),
        (float(e.crossover.mean()), float(e.crossover.std())),
        int((~e.stable).sum()),
        seconds,
    )


def test(tuners: Mapping[str, Tuner], task: Task) -> list[Evaluation]:
    """Give them all the test episodes."""
    return evaluate(
        tuners, task, CONTEXT_SETS["test"], episodes=TEST_EPISODES, seed=0, batch=TEST_EPISODES
    )


def compare(
    runs: Sequence[tuple[str, str]], seeds: int, episodes: int, folder: Path, progress: Progress
) -> list[Score]:
    """Train and test everything.

    Parameters
    ----------
    runs : sequence of (algorithm, compressor)
        Which agents.
    seeds : int
        Of each.
    episodes : int
        Longest training.
    folder : Path
        Where trained agents are kept, and found again.
    """
    task = Task()
    scores = [score(e, task, 0, 0) for e in test({n: c(task) for n, c in UNTRAINED.items()}, task)]
    for n in sizes(episodes):
        for name in ("ts-gbm", "ts-ff"):
            tuner = train_two_stage(name, task, episodes=n, progress=progress)
            scores += [score(e, task, n, 0) for e in test({name: tuner}, task)]
    for algorithm, compressor in runs:
        for seed in range(seeds):
            settings = rl.Training(algorithm, compressor, episodes, seed=seed)
            for n, (path, seconds) in agents(settings, folder, progress).items():
                found = test({f"{algorithm}-{compressor}": from_file(path)}, task)
                scores += [score(e, task, n, seed, seconds) for e in found]
    return scores


def interquartile_mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean of the middle half of (..., n) values, the quartiles' neighbours weighted in part."""
    ordered = np.sort(values)
    edges = np.linspace(0, 1, ordered.shape[-1] + 1)
    weight = np.clip(np.minimum(edges[1:], 0.75) - np.maximum(edges[:-1], 0.25), 0, None)
    return np.asarray(ordered @ weight / weight.sum())


def interval(values: NDArray[np.float64], seed: int = 0) -> tuple[float, float]:
    """95 % bootstrap interval of the interquartile mean over (n,) runs."""
    draws = np.random.default_rng(seed).choice(values, (2000, len(values)))
    low, high = np.quantile(interquartile_mean(draws), [0.025, 0.975])
    return float(low), float(high)


def curve(scores: Sequence[Score], name: str, value: Callable[[Score], float]) -> dict[int, Any]:
    """Episodes to (interquartile mean, low, high) of a value over the seeds."""
    found = {}
    for n in sorted({s.episodes for s in scores if s.name == name}):
        values = np.array([value(s) for s in scores if s.name == name and s.episodes == n])
        found[n] = (float(interquartile_mean(values)), *interval(values))
    return found


def to_markdown(scores: Sequence[Score], episodes: int) -> str:
    """What each agent reached at the end, seed by seed, and the median of seeds."""
    lines = [
        "| agent | seed | phase margin [°] mean ± std | crossover [Hz] mean ± std | unstable "
        "| training [s] |",
        "|---|---|---|---|---|---|",
    ]
    names = dict.fromkeys(s.name for s in scores if s.seconds)
    for name in names:
        rows = [s for s in scores if s.name == name and s.episodes == episodes]
        for s in rows:
            lines.append(
                f"| `{name}` | {s.seed} | {s.phase_margin[0]:.3f} ± {s.phase_margin[1]:.3f} "
                f"| {s.crossover[0]:.4f} ± {s.crossover[1]:.4f} | {s.unstable} | {s.seconds:.0f} |"
            )
        pm, fc = np.median([[s.phase_margin, s.crossover] for s in rows], axis=0)
        unstable, seconds = max(s.unstable for s in rows), np.median([s.seconds for s in rows])
        lines.append(
            f"| **`{name}`** | median | **{pm[0]:.3f} ± {pm[1]:.3f}** "
            f"| **{fc[0]:.4f} ± {fc[1]:.4f}** | {unstable} | {seconds:.0f} |"
        )
    return "\n".join(lines) + "\n"


def write(scores: Sequence[Score], episodes: int, results: Path) -> None:
    """Write ``rl.json`` and ``rl.md``."""
    results.mkdir(parents=True, exist_ok=True)
    write_text(results / "rl.json", json.dumps([asdict(s) for s in scores], indent=1) + "\n")
    write_text(results / "rl.md", to_markdown(scores, episodes))
