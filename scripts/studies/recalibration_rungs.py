"""Rungs of the ladder of re-calibration: ways to choose the gains of the window to come."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tuners.recalibration.belief import Belief
from tuners.recalibration.follower import Follower
from tuners.trust.verdict import Verdict, worst
from tuners.tuner.recording import Recording
from tuners.tuner.tuner import Tuner
from yawrate_env.vehicle.drive_conditions import Window
from yawrate_env.vehicle.drive_estimate import encode
from yawrate_env.vehicle.drive_information import Predictor
from yawrate_env.vehicle.drives import Course, Driven, Drives

Array = NDArray[np.float64]


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
