"""Ways to keep gains right while driving, on the same drives: a ladder from never to the oracle.

A rung chooses the gains of every window before it is driven; all but `oracle` see only windows that
are over, and the speed.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tuners.catalogue import load
from tuners.recalibration.belief import Belief
from tuners.recalibration.follower import Follower
from tuners.trust.verdict import Verdict, worst
from tuners.tuner.recording import Recording
from tuners.tuner.tuner import Tuner
from yawrate_env.compiled import cores
from yawrate_env.env.recalibration_env import PIRecalibrationVectorEnv
from yawrate_env.env.recalibration_interface import RecalibrationInterface
from yawrate_env.signals.streams import stream
from yawrate_env.vehicle.drive import drive
from yawrate_env.vehicle.drive_conditions import START_INTEGERS, WINDOW_INTEGERS, Conditions, Window
from yawrate_env.vehicle.drive_estimate import encode
from yawrate_env.vehicle.drive_information import Predictor
from yawrate_env.vehicle.drives import Course, Driven, Drives
from yawrate_env.vehicle.single_track import Vehicle

Array = NDArray[np.float64]
Row = dict[str, Any]
Progress = Callable[[str, int, int], Any]

_SETS = {"test": 60, "train": 61}
_RESAMPLES = 1000


class Rung(Protocol):
    """A way to choose gains; one object drives one batch."""

    def gains(self, course: Course, coming: Window) -> Array:
        """Gains (B, 2) for the windows to come."""

    def learn(self, before: Course, driven: Driven) -> None:
        """Take note of windows that are over."""


@dataclass(slots=True, eq=False)
class Never:
    """The gains that were right at the start."""

    drives: Drives
    start: Course

    def gains(self, course: Course, coming: Window) -> Array:
        """Those."""
        return self.start.gains

    def learn(self, before: Course, driven: Driven) -> None:
        """Nothing."""


@dataclass(slots=True, eq=False)
class Scheduled(Never):
    """The gains over speed that were right for friction and load at the start."""

    def gains(self, course: Course, coming: Window) -> Array:
        """At the speed to come."""
        return _at_speed(self.drives, self.start.theta, coming)


@dataclass(slots=True, eq=False)
class Late(Never):
    """Knows friction and load of the last window: what no one can do better who cannot foresee."""

    def gains(self, course: Course, coming: Window) -> Array:
        """At the speed to come."""
        return _at_speed(self.drives, course.theta, coming)


@dataclass(slots=True, eq=False)
class Oracle(Never):
    """Knows the vehicle of the window to come."""

    def gains(self, course: Course, coming: Window) -> Array:
        """The design rule's."""
        return self.drives.designed(coming.theta)


@dataclass(slots=True, eq=False)
class Alone(Never):
    """The design rule at the last window's own estimate, with the prior."""

    seen: bool = False

    def gains(self, course: Course, coming: Window) -> Array:
        """At the speed to come; before the first window those of the start."""
        if not self.seen:
            return self.start.gains
        theta = self.drives.estimator.theta(course.start, coming.theta[:, 2])
        return self.drives.designed(theta)

    def learn(self, before: Course, driven: Driven) -> None:
        """The course carries the estimate."""
        self.seen = True


@dataclass(slots=True, eq=False)
class Filtered:
    """The design rule at the filter's estimate, which starts from what is known at the start."""

    follower: Follower
    belief: Belief

    def gains(self, course: Course, coming: Window) -> Array:
        """At the speed to come."""
        return self.follower.gains(self.belief, coming.theta[:, 2])

    def learn(self, before: Course, driven: Driven) -> None:
        """One step of the filter."""
        self.belief = self.follower.followed(self.belief, driven.estimate)


@dataclass(slots=True, eq=False)
class Bound:
    """Estimates as good as the recursive information bound allows (Tichavsky et al., 1998).

    Information follows ``J+ = (J^-1 + Q)^-1 + F`` with the walk's covariance Q and the windows'
    information F at the truth; jumps are told after their window.  Gains are those of the design
    rule at the last window's vehicle with an error of covariance J^-1.
    """

    drives: Drives
    J: Array
    seed: int

    def gains(self, course: Course, coming: Window) -> Array:
        """At the speed to come."""
        self.seed += 1
        draws = np.random.default_rng(self.seed).standard_normal((len(course), 2, 1))
        error = (np.linalg.cholesky(np.linalg.inv(self.J)) @ draws)[..., 0]
        z = self.drives.estimator.inside(encode(course.theta, self.drives.vehicle) + error)
        return self.drives.designed(self.drives.estimator.theta(z, coming.theta[:, 2]))

    def learn(self, before: Course, driven: Driven) -> None:
        """One step of the recursion."""
        estimator, given = self.drives.estimator, self.drives.conditions
        predictor = Predictor.of(estimator.vehicle, driven.theta, estimator.noise, estimator.Ts)
        gram, _ = predictor.gram(driven.u, driven.y, before.predicted)
        P = np.linalg.inv(self.J)
        P[:, 0, 0] += (given.walk_rms[0] / driven.theta[:, 0]) ** 2
        jumped = np.abs(driven.theta[:, 0] - before.theta[:, 0]) > 6 * given.walk_rms[0]
        P[jumped, 0], P[jumped, :, 0] = 0.0, 0.0
        P[jumped, 0, 0] = estimator.prior.variance[0]
        self.J = np.linalg.inv(P) + gram[:, 1:, 1:]


@dataclass(slots=True, eq=False)
class TunedAlone(Never):
    """A tuner's answer to the last window; the gains stay where it has none, or refuses.

    Parameters
    ----------
    referenced : bool
        Whether it is told the loop's reference.
    heeded : bool
        Whether gains that it refuses are left out.
    """

    tuner: Tuner
    referenced: bool
    heeded: bool
    found: Array | None = None

    def gains(self, course: Course, coming: Window) -> Array:
        """As they were found."""
        return self.start.gains if self.found is None else self.found

    def learn(self, before: Course, driven: Driven) -> None:
        """Tune from command and yaw rate."""
        plant = self.tuner.plant
        known = np.full((len(driven), len(plant.prior)), np.nan)
        known[:, plant.indices(("v_x",))] = driven.theta[:, 2:]
        reference = driven.reference if self.referenced else None
        Ts = self.drives.target.Ts
        recording = Recording(driven.u, driven.y, Ts, known, reference=reference)
        with np.errstate(all="ignore"):
            answer, assessment = self.tuner.assess(recording)
        usable = np.asarray(np.isfinite(answer.values).all(axis=1))
        if self.heeded:
            verdicts = [
                worst([c.verdict for c in assessment.checks(i)]) for i in range(len(driven))
            ]
            usable &= np.array([verdict is not Verdict.REFUSE for verdict in verdicts])
        self.found = np.where(usable[:, None], answer.values, driven.gains)


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


def _at_speed(drives: Drives, theta: Array, coming: Window) -> Array:
    """Gains for friction and load of some vehicles (B, 3) at the speeds to come."""
    return drives.designed(np.column_stack([theta[:, :2], coming.theta[:, 2]]))


def ladder(drives: Drives, start: Course) -> dict[str, Rung]:
    """Rungs from never to the oracle, for drives that start here."""
    follower, certain = Follower.of(drives), np.tile(1e8 * np.eye(2), (len(start), 1, 1))
    return {
        "never re-tune": Never(drives, start),
        "never, scheduled over speed": Scheduled(drives, start),
        "every window alone, with the prior": Alone(drives, start),
        "filter": Filtered(follower, follower.known(start.theta)),
        "information bound": Bound(drives, certain, 0),
        "one window late": Late(drives, start),
        "oracle": Oracle(drives, start),
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
