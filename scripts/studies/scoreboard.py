"""Every tuner's scores under one fixed, versioned evaluation protocol.

    score = (mean reward - nominal's) / (oracle's - nominal's)

is 0 for the fixed gains of the mid-prior vehicle, which ignore the recording, and 1 for the
design rule that knows the vehicle.  All tuners get the same episodes, so differences are
paired, and intervals come from resampling episodes, the same ones for all.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.metrics import bootstrap_interval, rms
from studies.players import CLIMBER, LADDER, Ladder
from tuners import NAMES, load
from tuners.catalogue import UNTRAINED, shipped
from tuners.cli.answer import plain
from tuners.tuner.evaluation import Evaluation, Policy, evaluate
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

_BATCH = 256


@dataclass(frozen=True, slots=True)
class EvaluationProtocol:
    """What is evaluated on what; whatever changes a score makes a new version.

    Attributes
    ----------
    version : int
        Of the protocol.
    context_sets : tuple of str
        Families of episodes.
    episodes, seed : int
        How many of each, and which.
    """

    version: int = 1
    context_sets: tuple[str, ...] = ("test", "extrapolation")
    episodes: int = 1500
    seed: int = 0


PROTOCOL = EvaluationProtocol()


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value and its 95 % bootstrap interval over episodes."""

    value: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Array, statistic: Callable[..., Any]) -> "Estimate":
        """Statistic of (E,) or (E, k) values, which takes ``axis``."""
        if len(values) == 0:
            return cls(np.nan, np.nan, np.nan)
        low, high = bootstrap_interval(values, statistic)
        return cls(float(statistic(values, axis=0)), low, high)


@dataclass(frozen=True, slots=True)
class Row:
    """One tuner on one context set.

    Attributes
    ----------
    tuner, context_set : str
        Names.
    learned_from : str
        Data and seed of its training, in words.
    episodes, unstable, undefined : int
        All, those with an unstable loop, and those without a crossover.
    reward : Estimate
        Mean reward.
    regret : Estimate
        Mean of the oracle's reward minus its own on the same episode.
    score : Estimate
        0 for ``nominal``, 1 for ``oracle``.
    phase_margin, crossover : Estimate
        Root mean square error from the target [deg], [Hz], where defined.
    """

    tuner: str
    context_set: str
    learned_from: str
    episodes: int
    unstable: int
    undefined: int
    reward: Estimate
    regret: Estimate
    score: Estimate
    phase_margin: Estimate
    crossover: Estimate


def available() -> dict[str, Policy]:
    """Every named tuner that needs no training or is shipped trained, and the ladder."""
    known = [name for name in NAMES if name in UNTRAINED or shipped(name).exists()]
    return {**{name: load(name) for name in known}, LADDER: Ladder(load(CLIMBER))}


def run(
    tuners: Mapping[str, Policy],
    protocol: EvaluationProtocol = PROTOCOL,
    progress: Progress | None = None,
) -> list[Row]:
    """Evaluate tuners under a protocol; ``nominal`` and ``oracle`` must be among them.

    Returns
    -------
    list of Row
        Context set by context set, the best score first.
    """
    missing = {"nominal", "oracle"} - set(tuners)
    if missing:
        raise ValueError(f"{', '.join(sorted(missing))} must be evaluated too: the score's ends.")
    board = []
    for name in protocol.context_sets:

        def report(done: int, of: int, name: str = name) -> None:
            if progress is not None:
                progress(f"evaluating, {name}", done, of)

        found = evaluate(
            tuners, yaw_rate(Task()), name, episodes=protocol.episodes, seed=protocol.seed,
            batch=_BATCH, progress=report,
        )  # fmt: skip
        board += rows(found, name, {n: learned_from(t) for n, t in tuners.items()})
    return board


def rows(evaluations: Sequence[Evaluation], context: str, learned: Mapping[str, str]) -> list[Row]:
    """Rows of tuners on the same episodes, the best score first."""
    rewards = {e.tuner: e.plant.reward(e.theta, e.gains) for e in evaluations}
    board = []
    for e in evaluations:
        table = np.stack([rewards[n] for n in (e.tuner, "nominal", "oracle")], axis=1)
        margin, crossover = e.errors.T
        board.append(
            Row(
                e.tuner,
                context,
                learned[e.tuner],
                len(e.gains),
                int((~e.stable).sum()),
                int((~np.isfinite(margin)).sum()),
                Estimate.of(table[:, 0], np.mean),
                Estimate.of(table[:, 2] - table[:, 0], np.mean),
                Estimate.of(table, score),
                Estimate.of(margin[np.isfinite(margin)], rms),
                Estimate.of(crossover[np.isfinite(crossover)], rms),
            )
        )
    return sorted(board, key=lambda row: -row.score.value)


def score(rewards: Array, axis: int = 0) -> Array:
    """0 to 1 from the nominal's mean reward to the oracle's.

    Parameters
    ----------
    rewards : (..., E, 3)
        Its own, the nominal's and the oracle's.
    axis : int
        That of the episodes.
    """
    own, nominal, oracle = np.moveaxis(rewards.mean(axis=axis), -1, 0)
    return np.asarray((own - nominal) / (oracle - nominal))


def learned_from(tuner: Any) -> str:
    """Data and seed of a tuner's training, in words; of foreign policies nothing is known."""
    training = getattr(tuner, "training", None)
    if not isinstance(training, dict):
        return ""
    if "algorithm" in training:
        return f"{training['episodes']} rewards, {training['algorithm']}, seed {training['seed']}"
    if "episodes" in training:
        draws = training["noise_draws"]
        noise = f" × {draws} noise draws" if draws > 1 else ""
        return f"{training['episodes']} vehicles{noise}, seed {training['seed']}"
    return ""


def to_json(board: Sequence[Row], protocol: EvaluationProtocol) -> str:
    """Rows, the protocol and the task that they hold for; ``null`` where undefined."""
    content = {
        "protocol": asdict(protocol),
        "environment": "yawrate/PITuning-v0",
        "task": Task().settings(),
        "rows": plain([asdict(row) for row in board]),
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"
