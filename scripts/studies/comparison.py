"""How many plant interactions does reinforcement learning need?  Learning curves.

Agents of several seeds and two-stage tuners are given the same numbers of simulated
episodes and the same features, and all are tested on the same episodes.  Several runs are summed
up by the interquartile mean with a bootstrap interval over seeds (Agarwal et al., 2021).
"""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.bounds import bound_on
from studies.markdown import table
from studies.metrics import bootstrap_interval, rms
from tuners import Recipe, load, train
from tuners.agents import training as rl_training
from tuners.agents.settings import Training
from tuners.catalogue import UNTRAINED
from tuners.features import features_named
from tuners.learners.feedforward import FeedForwardSettings
from tuners.learners.threads import threads
from tuners.tuner.evaluation import Evaluation, Policy, evaluate
from yawrate_env.files import write_text
from yawrate_env.plant.plant import Plant
from yawrate_env.plant.reward import distance
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

EPISODES = (500, 1000, 2000, 5000, 10_000, 20_000)
"""Sizes at which agents and two-stage tuners are compared."""

TEST_EPISODES = 1500

BOUND = "Cramér–Rao bound"

TWO_STAGE = {"ff-laguerre": FeedForwardSettings(neurons=16, max_fail=10)}
"""Learners that are told the design rule's gains; their features are the agents'."""

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
    settings: Training, folder: Path, progress: Progress | None = None
) -> dict[int, tuple[Path, float]]:
    """Train one agent with snapshots at `sizes`, or find it already in `folder`.

    Returns
    -------
    dict
        Episodes to (file, seconds of the whole training).
    """
    folder.mkdir(parents=True, exist_ok=True)
    stem = f"{settings.algorithm}-{settings.features}-{settings.seed}"
    clock = folder / f"{stem}.json"
    files = {n: folder / f"{stem}-{n}.tuner" for n in sizes(settings.episodes)}
    done = json.loads(clock.read_text()) if clock.exists() else {}
    if done != {**asdict(settings), "seconds": done.get("seconds")}:  # none, or another length
        start = time.perf_counter()
        stage = features_named(str(settings.features))  # as yawrate/PITuningFeatures-v0 has it
        snapshots = rl_training.snapshots(
            replace(settings, features=stage), yaw_rate(Task()), tuple(files), progress=progress
        )
        done = {"seconds": time.perf_counter() - start, **asdict(settings)}
        for path, (_, tuner) in zip(files.values(), snapshots, strict=True):
            tuner.save(path)
        write_text(clock, json.dumps(done))
    return {n: (path, done["seconds"]) for n, path in files.items()}


def score(e: Evaluation, episodes: int, seed: int, seconds: float = 0.0) -> Score:
    """Sum up one evaluation."""
    errors = distance(e.errors / e.plant.metric_setting("scale"))
    margin, crossover = e.metrics.T
    return Score(
        e.tuner,
        episodes,
        seed,
        float(np.mean(errors)),
        (float(margin.mean()), float(margin.std())),
        (float(crossover.mean()), float(crossover.std())),
        int((~e.stable).sum()),
        seconds,
    )


def test(tuners: Mapping[str, Policy], plant: Plant) -> list[Evaluation]:
    """Give them all the test episodes."""
    return evaluate(tuners, plant, "test", episodes=TEST_EPISODES, seed=0, batch=TEST_EPISODES)


def compare(
    runs: Sequence[tuple[str, str]], seeds: int, episodes: int, folder: Path, progress: Progress
) -> list[Score]:
    """Train and test everything.

    Parameters
    ----------
    runs : sequence of (algorithm, features)
        Which agents.
    seeds : int
        Of each.
    episodes : int
        Longest training.
    folder : Path
        Where trained agents are kept, and found again.
    """
    plant = yaw_rate(Task())
    scores = [score(e, 0, 0) for e in test({n: load(n) for n in UNTRAINED}, plant)]
    scores.append(_bound(plant))
    for n in sizes(episodes):
        for name, learner in TWO_STAGE.items():
            recipe = Recipe(features_named("laguerre"), learner)
            tuner = train(recipe, plant, episodes=n, calibration=0, progress=progress)
            scores += [score(e, n, 0) for e in test({name: tuner}, plant)]
    for algorithm, features in runs:
        for seed in range(seeds):
            settings = Training(algorithm, features, episodes, seed=seed)
            for n, (path, seconds) in agents(settings, folder, progress).items():
                found = test({f"{algorithm}-{features}": load(path)}, plant)
                scores += [score(e, n, seed, seconds) for e in found]
    return scores


def _bound(plant: Plant) -> Score:
    """The bound as if it were a tuner's scatter about the target; its mean error is not known."""
    margin, crossover = rms(bound_on(plant, "test", 0, TEST_EPISODES)).tolist()
    return Score(BOUND, 0, 0, np.nan, (60.0, margin), (1.5, crossover), 0)


def merged(new: Sequence[Score], path: Path) -> list[Score]:
    """The new scores, and of a stored file those that were not found again."""
    if not path.exists():
        return list(new)
    stored = [Score(**row) for row in json.loads(path.read_text())]
    runs = {(s.name, s.episodes, s.seed) for s in new}
    return [*(s for s in stored if (s.name, s.episodes, s.seed) not in runs), *new]


def interquartile_mean(values: NDArray[np.float64], axis: int = -1) -> NDArray[np.float64]:
    """Mean of the middle half of (..., n) values, the quartiles' neighbours weighted in part."""
    ordered = np.moveaxis(np.sort(values, axis=axis), axis, -1)
    edges = np.linspace(0, 1, ordered.shape[-1] + 1)
    weight = np.clip(np.minimum(edges[1:], 0.75) - np.maximum(edges[:-1], 0.25), 0, None)
    return np.asarray(ordered @ weight / weight.sum())


def curve(scores: Sequence[Score], name: str, value: Callable[[Score], float]) -> dict[int, Any]:
    """Episodes to (interquartile mean, low, high) of a value over the seeds."""
    found = {}
    for n in sorted({s.episodes for s in scores if s.name == name}):
        values = np.array([value(s) for s in scores if s.name == name and s.episodes == n])
        found[n] = (
            float(interquartile_mean(values)),
            *bootstrap_interval(values, interquartile_mean),
        )
    return found


HEADS = (
    "agent", "episodes", "seed", "phase margin rms [°]", "crossover rms [Hz]", "× bound",
    "unstable", "training [s]",
)  # fmt: skip

FOREWORD = """\
1500 test episodes, target 60° and 1.5 Hz; rms errors, bias included. Every learner in this table
and its figure sees the same ten Laguerre features, standardised, and acts in the same range: the
loop coordinates that the design rule needs at the prior's plants and a quarter more. `naf` also
knows the reward's documented form, e = −r/(1 + r/4); `naf-plain` is the same learner on the
plain reward (e = −r), and the difference between the two is what that knowledge is worth. No agent
sees the design rule's gains. The agents called `rl` and `rl-sac` are `naf-laguerre` and
`sac-laguerre` with seed 0. Times in the table are wall times of a machine that did other work
beside `naf`.
"""


BESIDE = """\
## Other ways to learn

From recorded episodes alone (`scripts/compare_rl.py --offline`; Minari sets of
`yawrate/PITuningFeatures-v0`, `tuners.data.export_minari`, with reference scores): `naf-offline`
sees actions and rewards of a mixture of random, disturbed, nominal and best actions in equal parts,
`naf-offline-uniform` those of random actions alone; `bc-offline` clones the mixture's actions, as
Minari's tutorial does, and so learns their mean. d3rlpy asks for an older Gymnasium.

From raw samples (`--raw`): `transformer-raw` reads the recording itself, averaged down to 100 Hz,
in 25 pieces of 0.4 s; three layers of width 64, 6 passes over as many simulations (a minute of
processor time), and labels by the design rule. Labels and simulations are those of the two-stage
learner `ff-laguerre` (`ts-ff-lag`'s recipe): a linear first stage,
which knows what noise is, is worth more here than attention.
"""

OTHERS = "naf-offline", "naf-offline-uniform", "bc-offline", "transformer-raw"
"""Learners that do not gather episodes themselves, or see no features."""


TIMES = "rl_times.json"

_TIMES = """\
Processor time of whole trainings with seed 0, calibration included, in one process on one core:
`rl` {rl:.0f} s ({episodes:,} episodes), `ts-ff-lag` {ff:.0f} s, a ratio of {ratio:.2f}.
"""


def times(episodes: int, progress: Progress) -> dict[str, float]:
    """Processor time of training `rl` and `ts-ff-lag` [s]: other processes do not count."""
    plant, found = yaw_rate(Task()), {"episodes": float(episodes)}
    with threads(1):
        for name in ("ts-ff-lag", "rl"):
            began = time.process_time()
            if name == "rl":
                settings = Training("naf", features_named("laguerre"), episodes, seed=0)
                rl_training.train(settings, plant, progress=progress)
            else:
                train(name, plant, progress=progress)
            found[name] = time.process_time() - began
    return found


def to_markdown(scores: Sequence[Score], timed: Mapping[str, float] | None = None) -> str:
    """What each agent reached at the end of its trainings, seed by seed, and the median."""
    bound = next((_rms(s) for s in scores if s.name == BOUND), (np.nan, np.nan))
    trained = [s for s in scores if s.seconds]
    others = [s for s in trained if s.name in OTHERS]
    agents = _rows([s for s in trained if s.name not in OTHERS], bound)
    page = f"{FOREWORD}\n{table(HEADS, agents)}"
    if timed:
        rl, ff, episodes = (timed[name] for name in ("rl", "ts-ff-lag", "episodes"))
        page += f"\n{_TIMES.format(rl=rl, ff=ff, episodes=int(episodes), ratio=rl / ff)}"
    return f"{page}\n{BESIDE}\n{table(HEADS, _rows(others, bound))}" if others else page


def _rows(agents: Sequence[Score], bound: tuple[float, float]) -> list[tuple[object, ...]]:
    rows: list[tuple[object, ...]] = []
    longest = max((s.episodes for s in agents), default=0)
    ends = (s for s in agents if s.episodes == longest or s.episodes not in EPISODES)
    for name, n in sorted(dict.fromkeys((s.name, s.episodes) for s in ends)):
        found = sorted((s for s in agents if (s.name, s.episodes) == (name, n)), key=_seed)
        for s in found:
            about = s.unstable, f"{s.seconds:.0f}"
            rows.append((f"`{name}`", n, s.seed, *_cells(_rms(s), bound), *about))
        middle = _cells(np.median([_rms(s) for s in found], axis=0), bound)
        worst = max(s.unstable for s in found), f"{np.median([s.seconds for s in found]):.0f}"
        median = (f"**{text}**" for text in middle)
        rows.append((f"**`{name}`**", n, f"median of {len(found)}", *median, *worst))
    return rows


def _seed(s: Score) -> int:
    return s.seed


def _rms(s: Score) -> tuple[float, float]:
    """Errors from the target, (deg, Hz)."""
    margin, crossover = s.phase_margin, s.crossover
    return float(np.hypot(margin[0] - 60.0, margin[1])), float(
        np.hypot(crossover[0] - 1.5, crossover[1])
    )


def _cells(errors: Any, bound: tuple[float, float]) -> tuple[str, ...]:
    ratios = " / ".join(f"{e / b:.3g}" for e, b in zip(errors, bound, strict=True))
    return f"{errors[0]:.3g}", f"{errors[1]:.3g}", ratios


def write(scores: Sequence[Score], results: Path) -> list[Score]:
    """Write ``rl.json`` and ``rl.md``, what is stored there and was not found again kept."""
    results.mkdir(parents=True, exist_ok=True)
    everything = merged(scores, results / "rl.json")
    write_text(results / "rl.json", json.dumps([asdict(s) for s in everything], indent=1) + "\n")
    path = results / TIMES
    timed = json.loads(path.read_text()) if path.exists() else None
    write_text(results / "rl.md", to_markdown(everything, timed))
    return everything
