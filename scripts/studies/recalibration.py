"""Ways to keep gains right while driving, on the same drives, and what the filters do not know."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.recalibration_faults import FAULTS, Fault
from studies.recalibration_rungs import (
    Alone,
    BankMean,
    Bound,
    Filtered,
    Late,
    Never,
    Oracle,
    Rung,
    Scheduled,
    TunedAlone,
)
from tuners.catalogue import load
from tuners.recalibration.bank import Bank
from tuners.recalibration.doubt import ORDER, Doubt
from tuners.recalibration.follower import Follower
from tuners.tuner.tuner import Tuner
from yawrate_env.compiled import cores
from yawrate_env.env.recalibration_env import PIRecalibrationVectorEnv
from yawrate_env.env.recalibration_interface import RecalibrationInterface
from yawrate_env.signals.streams import stream
from yawrate_env.vehicle.drive import drive
from yawrate_env.vehicle.drive_conditions import START_INTEGERS, WINDOW_INTEGERS
from yawrate_env.vehicle.drives import Course, Drives

Array = NDArray[np.float64]
Row = dict[str, Any]
Progress = Callable[[str, int, int], Any]

_SETS = {"test": 60, "train": 61}
_RESAMPLES = 1000
_JUMP = 6.0  # deviations of the walk
_MISSED = 3.0, 0.15  # deg, Hz


@dataclass(frozen=True, slots=True, eq=False)
class Ride:
    """What a rung did on D drives of T windows.

    Attributes
    ----------
    errors : NDArray
        (D, T, 2) distance of phase margin [deg] and crossover [Hz] from what the rule reaches;
        ``nan`` once a loop was unstable.
    rewards : NDArray
        (D, T) zero once a loop was unstable.
    unstable : NDArray
        (D, T) loops that became so.
    cost : NDArray
        (D, T) of ``yawrate/PIRecalibration-v0``.
    jumped : NDArray
        (D, T) windows before which friction jumped.
    """

    errors: Array
    rewards: Array
    unstable: NDArray[np.bool_]
    cost: Array
    jumped: NDArray[np.bool_]


def ladder(drives: Drives, start: Course) -> dict[str, Rung]:
    """Rungs from never to the oracle, for drives that start here."""
    certain = np.tile(1e8 * np.eye(2), (len(start), 1, 1))
    return {
        "never re-tune": Never(drives, start),
        "never, scheduled over speed": Scheduled(drives, start),
        "every window alone, with the prior": Alone(drives, start),
        **filters(drives, start),
        "information bound": Bound(drives, certain, 0),
        "one window late": Late(drives, start),
        "oracle": Oracle(drives, start),
    }


def filters(assumed: Drives, start: Course) -> dict[str, Rung]:
    """The bank, and the filter that it has as one hypothesis, of cars known at the start."""
    bank, follower = Bank.of(assumed), Follower.of(assumed)
    return {
        "filter, data as exact": Filtered.of(follower, start),
        "filter": BankMean(bank, bank.known(start.theta)),
    }


def trials(drives: Drives, start: Course, tuners: Mapping[str, Tuner]) -> dict[str, Rung]:
    """Tuners on every window alone."""
    rungs: dict[str, Rung] = {}
    for name, tuner in tuners.items():
        for way, referenced, heeded in (
            ("on every window", False, False),
            ("with the reference", True, False),
            ("with the reference, unless it refuses", True, True),
        ):
            rungs[f"`{name}` {way}"] = TunedAlone(drives, start, tuner, referenced, heeded)
    return rungs


def begun(drives: Drives, seed: int, count: int, name: str = "test") -> Course:
    """The drives of a seed, at their start."""
    return drives.begin(stream((_SETS[name], seed), 0, count, START_INTEGERS))


def ride(
    interface: RecalibrationInterface,
    rung: Rung,
    start: Course,
    seed: int,
    name: str = "test",
    fault: Fault | None = None,
) -> Ride:
    """Drive all windows; an unstable loop ends its drive."""
    fault, count, T = fault or Fault(), len(start), interface.windows
    errors = np.full((count, T, 2), np.nan)
    rewards, cost = np.zeros((count, T)), np.zeros((count, T))
    unstable, jumped = np.zeros((2, count, T), np.bool_)
    course, alive = start, np.ones(count, np.bool_)
    for t in range(T):
        drawn = stream((_SETS[name], seed, 1 + t), 0, count, WINDOW_INTEGERS)
        drives, course = fault.drives(interface.drives, t), fault.course(course, t)
        coming = fault.window(drives.coming(course, drawn))
        gains = rung.gains(course, coming)
        gains = np.where(np.isfinite(gains).all(axis=1, keepdims=True), gains, course.gains)
        changed = (gains != course.gains).any(axis=1)
        far = np.abs(coming.theta[:, 0] - course.theta[:, 0])
        jumped[:, t] = far > _JUMP * drives.conditions.walk_rms[0]
        after, driven = drives.window(course, coming, gains)
        rung.learn(course, driven)
        reward, info = interface.outcome(driven, changed)
        errors[alive, t] = (driven.metrics[:, :2] - driven.wanted)[alive]
        rewards[alive, t], cost[alive, t] = reward[alive], info["cost"][alive]
        unstable[:, t] = alive & ~driven.stable
        alive &= driven.stable
        course = after
    return Ride(errors, rewards, unstable, cost, jumped)


def row(name: str, ride: Ride, seed: int = 0) -> Row:
    """Means over drives with 95 % bootstrap intervals over drives."""
    phase, crossover = np.abs(np.moveaxis(ride.errors, 2, 0))
    rng = np.random.default_rng(seed)
    columns = {
        "phase_margin": np.nanmean(phase, axis=1),
        "crossover": np.nanmean(crossover, axis=1),
        "return": ride.rewards.sum(axis=1),
        "cost": ride.cost.mean(axis=1),
    }
    chosen = rng.integers(0, len(phase), (_RESAMPLES, len(phase)))
    found: Row = {"rung": name, "drives": len(phase), "windows": int(np.isfinite(phase).sum())}
    for key, values in columns.items():
        low, high = np.quantile(values[chosen].mean(axis=1), [0.025, 0.975])
        found[key] = {"mean": float(values.mean()), "low": float(low), "high": float(high)}
    found["unstable"] = int(ride.unstable.sum())
    return found


def interface(drives: Drives) -> RecalibrationInterface:
    """Of ``yawrate/PIRecalibration-v0`` with its default settings."""
    return RecalibrationInterface.of(drives, windows=50, price=0.01, probing=0.0, comfort=0.0)


def study(
    drives: int,
    tuned: int,
    seed: int,
    names: Sequence[str],
    progress: Callable[[str, int, int], Any],
) -> Row:
    """The ladder, and that of tuners on fewer drives."""
    usual, rows = interface(Drives.of()), []
    start, few = (begun(usual.drives, seed, count) for count in (drives, tuned))
    few_kept = "never re-tune, on the tuners' drives"
    rungs: list[tuple[str, Rung, Course]] = [
        *((name, rung, start) for name, rung in ladder(usual.drives, start).items()),
        (few_kept, Never(usual.drives, few), few),
        *((name, rung, few) for name, rung in trials(
            usual.drives, few, {name: load(name) for name in names}).items()),
    ]  # fmt: skip
    for done, (name, rung, at) in enumerate(rungs, 1):
        rows.append(row(name, ride(usual, rung, at, seed)))
        progress("ladder", done, len(rungs))
    return {"seed": seed, "rows": rows}


def renewed(rows: Sequence[Row], drives: int, seed: int) -> list[Row]:
    """Rows of which those of the filters are ridden again."""
    usual = interface(Drives.of())
    start = begun(usual.drives, seed, drives)
    found = {name: row(name, ride(usual, rung, start, seed))
             for name, rung in filters(usual.drives, start).items()}  # fmt: skip
    others = [each for each in rows if each["rung"] not in found]
    at = next(i for i, each in enumerate(others) if each["rung"] == "information bound")
    return [*others[:at], *found.values(), *others[at:]]


def trust(ride: Ride, doubts: Sequence[Doubt]) -> Row:
    """Verdicts, and how they and the intervals hold, in windows before which nothing jumped.

    The first window does not count: nothing has been seen before it.
    """
    verdict = np.stack([each.verdict for each in doubts], axis=1)
    half = np.stack([each.half for each in doubts], axis=1)
    counts = ~ride.jumped
    counts[:, 0] = False
    off = np.where(np.isfinite(ride.errors), np.abs(ride.errors), np.inf)
    wrong = np.asarray((off > _MISSED).any(axis=2))
    share = {each.value: float((verdict == i)[counts].mean()) for i, each in enumerate(ORDER)}
    usable = counts & (verdict == 0)
    return {
        **share,
        "wrong": int((usable & wrong).sum()),
        "of": int(usable.sum()),
        "missed": float(wrong[counts].mean()),
        "coverage": (off <= half)[counts].mean(axis=0).tolist(),
        "half": np.median(half[counts], axis=0).tolist(),
    }


def faults(count: int, seed: int, progress: Progress) -> list[Row]:
    """The filters where their assumptions are wrong."""
    found = []
    for done, name in enumerate(FAULTS, 1):
        found.append({"fault": name, **under(FAULTS[name], count, seed)})
        progress("faults", done, len(FAULTS))
    return found


def under(fault: Fault, count: int, seed: int) -> Row:
    """Never re-tuning and the filters in drives with a fault."""
    assumed = Drives.of()
    true = fault.of(assumed)
    start, usual = begun(true, seed, count), interface(true)
    bank = Bank.of(assumed)
    banked = BankMean(bank, bank.known(start.theta))
    rungs: dict[str, Rung] = {"never": Never(true, start), "scheduled": Scheduled(true, start),
                              **filters(assumed, start), "filter": banked}  # fmt: skip
    rides = {name: ride(usual, rung, start, seed, fault=fault) for name, rung in rungs.items()}
    found: Row = {name: row(name, each) for name, each in rides.items()}
    found["trust"] = trust(rides["filter"], banked.doubts)
    return found


def speed(batch: int, rounds: int) -> Row:
    """Windows a second of the native batch environment, and shares of its parts; fastest rounds."""
    made = Drives.of()
    env = PIRecalibrationVectorEnv(batch)
    env.reset(seed=0)
    actions = np.tile([0.0, 0.0, 1.0], (batch, 1))
    course = begun(made, 0, batch)
    drawn = stream((_SETS["test"], 0, 1), 0, batch, WINDOW_INTEGERS)
    coming = made.coming(course, drawn)
    loops = made.loops(coming.theta)
    after, driven = made.window(course, coming, course.gains)
    disturbance = made.conditions.disturbed(coming.white, course.disturbance)
    parts: dict[str, Callable[[], Any]] = {
        "whole": lambda: env.step(actions),
        "noise, disturbance, references": lambda: (
            made.coming(course, drawn),
            made.conditions.disturbed(coming.white, course.disturbance)),
        "vehicles": lambda: made.loops(coming.theta),
        "closed loop": lambda: drive(loops.plant, course.gains, made.target, coming.reference,
                                     disturbance, coming.noise, course.state),
        "features and covariance": lambda: made.estimator(
            driven.u, driven.y, coming.theta[:, 2], course.predicted, after.start),
        "design": loops.design,
        "margins and stability": lambda: loops.evaluate(*course.gains.T),
    }  # fmt: skip
    seconds: dict[str, list[float]] = {name: [] for name in parts}
    for _ in range(rounds + 1):
        for name, part in parts.items():
            begin = time.perf_counter()
            part()
            seconds[name].append(time.perf_counter() - begin)
    fastest = {name: min(values[1:]) for name, values in seconds.items()}
    whole = fastest.pop("whole")
    shares = {name: value / whole for name, value in fastest.items()}
    return {"batch": batch, "cores": cores(), "windows_per_second": batch / whole,
            "shares": {**shares, "everything else": 1 - sum(shares.values())}}  # fmt: skip
