"""Who breaks where: learner, fitted plant, black box and the ladder of them under faults.

Every kind of `studies.robustness_kinds` under every condition: whose gains miss on the true
vehicle, what the verdicts say of the ladder's, and whether its intervals hold.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from studies.drives import Fault, record
from studies.faulty import Array, Faulty, Flags
from studies.players import Remembering
from studies.robustness_kinds import GROUPS, LOG_ONLY
from studies.trusting import MISS
from tuners import Tuner
from tuners.trust.checks import Assessment
from tuners.trust.verdict import Verdict
from tuners.tuner.ladder import Climb
from tuners.tuner.method import Rung
from yawrate_env import validation
from yawrate_env.vehicle.task import Task

Progress = Callable[[str, int, int], None]

PLAYERS = ("learner", "fitted plant", "black box", "ladder")
"""Whose gains are compared: each rung alone, and the ladder."""

_CHUNK = 100


@dataclass(frozen=True, slots=True)
class Condition:
    """Noise and length of recordings.

    Attributes
    ----------
    snr_db : float
        Signal over noise [dB].
    seconds : float
        Length [s].
    """

    snr_db: float
    seconds: float

    @property
    def name(self) -> str:
        """As tables show it."""
        return f"{self.snr_db:g} dB, {self.seconds:g} s"

    def of(self, task: Task) -> Task:
        """The task under this condition."""
        N = round(self.seconds / task.experiment.Ts)
        return replace(task, experiment=replace(task.experiment, N=N, snr_db=self.snr_db))


CONDITIONS = (Condition(30.0, 10.0), Condition(20.0, 5.0), Condition(14.0, 5.0))


@dataclass(frozen=True, slots=True)
class Row:
    """One kind of fault under one condition, or several of them together.

    Attributes
    ----------
    group, kind, condition : str
        Which.
    recordings, reachable : int
        All, and those whose true vehicle can reach the target.
    misses : dict
        By player, gains that miss: unstable, or farther than `MISS` from the target, or from
        what the design rule reaches where it does not reach the target.
    verdicts, missed : dict
        By verdict, the ladder's answers, and its misses.
    rungs : dict
        By name of the rung that answered.
    good : int
        The ladder's answers that neither miss nor are refused.
    rms : tuple of float
        Root mean square of their distance from what is reachable [deg], [Hz].
    trusted, covered : int, tuple of int
        Answers that are not refused, and how many of the 90 % intervals of phase margin and of
        crossover contain the true one.
    asked : int or None
        Answers usable with care whose reasons contain a question; None where it was not looked
        at.
    """

    group: str
    kind: str
    condition: str
    recordings: int
    reachable: int
    misses: Mapping[str, int]
    verdicts: Mapping[str, int]
    missed: Mapping[str, int]
    rungs: Mapping[str, int]
    good: int
    rms: tuple[float, float]
    trusted: int
    covered: tuple[int, int]
    asked: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """What became of B recordings.

    Attributes
    ----------
    reachable : NDArray
        (B,) whether the target can be reached.
    errors : dict
        By player, (B, 2) distance from what is reachable [deg], [Hz]; ``nan`` if unstable.
    verdicts, rung : NDArray
        (B,) position in `Verdict`, and `Rung`.
    inside : NDArray
        (B, 2) whether the true phase margin and crossover lie inside the intervals.
    asked : NDArray or None
        (B,) whether the answer is usable with care and a reason is a question.
    """

    reachable: Flags
    errors: Mapping[str, Array]
    verdicts: NDArray[np.int64]
    rung: NDArray[np.int64]
    inside: Flags
    asked: Flags | None = None


def study(
    tuner: Tuner,
    task: Task,
    *,
    count: int,
    seed: int = 0,
    groups: Mapping[str, Mapping[str, Fault]] = GROUPS,
    conditions: Sequence[Condition] = CONDITIONS,
    progress: Progress | None = None,
) -> list[Row]:
    """Measure every kind under every condition.

    Parameters
    ----------
    tuner : Tuner
        With all rungs.
    count : int
        Recordings of each kind under each condition.
    progress : callable, optional
        Called with the group, how many of its kinds are done, and of how many.
    """
    validation.count("recordings", count)
    validation.count("seed", seed, at_least=0)
    rows = []
    for group, kinds in groups.items():
        for done, (kind, fault) in enumerate(kinds.items(), start=1):
            rows += [
                measure(tuner, task, (group, kind), fault, condition, count, seed)
                for condition in conditions
            ]
            if progress is not None:
                progress(group, done, len(kinds))
    return rows


def measure(
    tuner: Tuner,
    task: Task,
    which: tuple[str, str],
    fault: Fault,
    condition: Condition,
    count: int,
    seed: int,
) -> Row:
    """One kind, ``which = (group, kind)``, under one condition."""
    group, kind = which
    stream = crc32(f"{kind}, {condition.name}".encode())
    found = []
    for first in range(0, count, _CHUNK):
        rng = np.random.default_rng((seed, stream, first))
        own = condition.of(task)
        made = record(fault, own, rng, min(_CHUNK, count - first))
        found.append(answered(tuner, own, made, questions=group == LOG_ONLY))
    return summed_up((group, kind, condition.name), found)


def answered(tuner: Tuner, task: Task, made: Faulty, *, questions: bool = False) -> Answers:
    """Everybody's gains for recordings, judged with the true vehicles."""
    tuner = Remembering(tuner)
    climbed, found = tuner.climb(made.recording)
    goal, reachable = made.reachable(task)
    goal[reachable] = task.target.phase_margin, task.target.crossover
    errors, reached = {}, goal
    for name, gains in _gains(tuner, made, climbed, found).items():
        reached, stable = made.reached(task, gains)
        errors[name] = np.where(stable[:, None], reached - goal, np.nan)
    half = np.array(tuner.calibration) * found.spread
    inside = np.abs(reached - found.metrics) <= half  # the last is the ladder's
    asked = None
    if questions:
        results = tuner.results(made.recording)
        asks = np.array([any("?" in reason for reason in r.reasons) for r in results])
        asked = asks & (found.verdicts == list(Verdict).index(Verdict.USABLE_WITH_CARE))
    return Answers(reachable, errors, found.verdicts, climbed.rung, inside, asked)


def _gains(tuner: Tuner, made: Faulty, climbed: Climb, found: Assessment) -> dict[str, Array]:
    """Gains (B, 2) of every player in the order of `PLAYERS`."""
    assert found.response is not None
    model = found.model
    rested = replace(made.recording, u=model.u, y=model.y)
    learner = tuner.gains(rested).values
    fitted, _ = tuner.plant.designs(found.fit.theta)
    everyone = learner, fitted, found.response.gains, climbed.gains.values
    return dict(zip(PLAYERS, everyone, strict=True))


def summed_up(which: tuple[str, str, str], parts: Sequence[Answers]) -> Row:
    """Count; `which` is group, kind and condition."""

    def joined(name: str) -> NDArray[Any]:
        return np.concatenate([getattr(part, name) for part in parts])

    errors = {n: np.concatenate([p.errors[n] for p in parts]) for n in PLAYERS}
    missed = {n: ~(np.abs(e) <= MISS).all(axis=1) for n, e in errors.items()}
    verdicts, rung, wrong = joined("verdicts"), joined("rung"), missed["ladder"]
    trusted = verdicts < len(Verdict) - 1
    good = errors["ladder"][~wrong & trusted]
    size = np.sqrt((good**2).mean(axis=0)) if len(good) else np.zeros(2)
    held = joined("inside")[trusted].sum(axis=0)
    return Row(
        *which,
        recordings=len(verdicts),
        reachable=int(joined("reachable").sum()),
        misses={name: int(rows.sum()) for name, rows in missed.items()},
        verdicts={str(v): int((verdicts == i).sum()) for i, v in enumerate(Verdict)},
        missed={str(v): int(((verdicts == i) & wrong).sum()) for i, v in enumerate(Verdict)},
        rungs={r.name.lower(): int((rung == r).sum()) for r in Rung},
        good=len(good),
        rms=(float(size[0]), float(size[1])),
        trusted=int(trusted.sum()),
        covered=(int(held[0]), int(held[1])),
        asked=None if parts[0].asked is None else int(joined("asked").sum()),
    )


def pooled(rows: Sequence[Row], group: str = "", kind: str = "") -> Row:
    """Several rows as one."""
    first = rows[0]

    def total(name: str) -> dict[str, int]:
        return {key: sum(getattr(r, name)[key] for r in rows) for key in getattr(first, name)}

    good = sum(r.good for r in rows)
    square = [sum(r.good * r.rms[i] ** 2 for r in rows) / max(good, 1) for i in (0, 1)]
    asked = [r.asked for r in rows if r.asked is not None]
    return Row(
        group or first.group, kind or first.kind, "together",
        sum(r.recordings for r in rows), sum(r.reachable for r in rows),
        total("misses"), total("verdicts"), total("missed"), total("rungs"), good,
        (float(np.sqrt(square[0])), float(np.sqrt(square[1]))), sum(r.trusted for r in rows),
        (sum(r.covered[0] for r in rows), sum(r.covered[1] for r in rows)),
        sum(asked) if asked else None,
    )  # fmt: skip


def plain(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Rows as JSON values."""
    return [asdict(row) for row in rows]
