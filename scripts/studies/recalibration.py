"""Ways to keep gains right while driving, on the same drives: a ladder from never to the oracle.

A rung chooses the gains of every window before it is driven; all but `oracle` see only windows that
are over, and the speed.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.recalibration_rungs import Filtered, Never, Rung, Scheduled, ladder, trials
from tuners.catalogue import load
from tuners.recalibration.follower import Follower
from yawrate_env.compiled import cores
from yawrate_env.env.recalibration_env import PIRecalibrationVectorEnv
from yawrate_env.env.recalibration_interface import RecalibrationInterface
from yawrate_env.signals.streams import stream
from yawrate_env.vehicle.drive import drive
from yawrate_env.vehicle.drive_conditions import START_INTEGERS, WINDOW_INTEGERS, Conditions
from yawrate_env.vehicle.drives import Course, Drives
from yawrate_env.vehicle.single_track import Vehicle

Array = NDArray[np.float64]
Row = dict[str, Any]
Progress = Callable[[str, int, int], Any]

_SETS = {"test": 60, "train": 61}
_RESAMPLES = 1000


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
    """

    errors: Array
    rewards: Array
    unstable: NDArray[np.bool_]
    cost: Array


def begun(drives: Drives, seed: int, count: int, name: str = "test") -> Course:
    """The drives of a seed, at their start."""
    return drives.begin(stream((_SETS[name], seed), 0, count, START_INTEGERS))


def ride(
    interface: RecalibrationInterface, rung: Rung, start: Course, seed: int, name: str = "test"
) -> Ride:
    """Drive all windows; an unstable loop ends its drive."""
    drives, count, T = interface.drives, len(start), interface.windows
    errors = np.full((count, T, 2), np.nan)
    rewards, cost = np.zeros((count, T)), np.zeros((count, T))
    unstable = np.zeros((count, T), np.bool_)
    course, alive = start, np.ones(count, np.bool_)
    for t in range(T):
        drawn = stream((_SETS[name], seed, 1 + t), 0, count, WINDOW_INTEGERS)
        coming = drives.coming(course, drawn)
        gains = rung.gains(course, coming)
        gains = np.where(np.isfinite(gains).all(axis=1, keepdims=True), gains, course.gains)
        changed = (gains != course.gains).any(axis=1)
        after, driven = drives.window(course, coming, gains)
        rung.learn(course, driven)
        reward, info = interface.outcome(driven, changed)
        errors[alive, t] = (driven.metrics[:, :2] - driven.wanted)[alive]
        rewards[alive, t], cost[alive, t] = reward[alive], info["cost"][alive]
        unstable[:, t] = alive & ~driven.stable
        alive &= driven.stable
        course = after
    return Ride(errors, rewards, unstable, cost)


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


FAULTS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "as assumed": ({}, {}),
    "no disturbance": ({"disturbance": 0.0}, {}),
    "disturbance × 2": ({"disturbance": float(np.radians(0.1))}, {}),
    "disturbance 5 times faster": ({"disturbance_time": 0.03}, {}),
    "disturbance 4 times slower": ({"disturbance_time": 0.6}, {}),
    "gyro noise × 2": ({"noise": float(np.radians(0.2))}, {}),
    "gyro noise × 0.5": ({"noise": float(np.radians(0.05))}, {}),
    "yaw inertia + 10 %": ({}, {"J_z": 1.1 * Vehicle().J_z}),
    "front stiffness − 10 %": ({}, {"C_f": 0.9 * Vehicle().C_f}),
    "actuator bandwidth − 10 %": ({}, {"omega_n": 0.9 * Vehicle().omega_n}),
}
"""What the filter does not know: conditions, and constants of the vehicle."""


def faulty(fault: str) -> tuple[Drives, Drives]:
    """Drives as they are, read by the estimator of drives as they are assumed; and those."""
    conditions, constants = FAULTS[fault]
    assumed = Drives.of()
    true = Drives.of(replace(Vehicle(), **constants), replace(Conditions(), **conditions))
    return replace(true, estimator=assumed.estimator), assumed


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
    """The ladder, that of tuners on fewer drives, and the filter under faults."""
    usual, rows, faults = interface(Drives.of()), [], []
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
    for done, fault in enumerate(FAULTS, 1):
        faults.append({"fault": fault, **under(fault, max(drives // 4, 1), seed)})
        progress("faults", done, len(FAULTS))
    return {"seed": seed, "rows": rows, "faults": faults}


def under(fault: str, count: int, seed: int) -> Row:
    """Never re-tuning and the filter where the filter's assumptions are wrong."""
    true, assumed = faulty(fault)
    start, usual, follower = begun(true, seed, count), interface(true), Follower.of(assumed)
    rungs: dict[str, Rung] = {"never": Never(true, start), "scheduled": Scheduled(true, start),
             "filter": Filtered(follower, follower.known(start.theta))}  # fmt: skip
    return {name: row(name, ride(usual, rung, start, seed)) for name, rung in rungs.items()}


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
