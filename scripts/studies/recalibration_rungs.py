"""Ways to keep gains right while driving, from never changing them to knowing every window.

A rung chooses the gains of every window before it is driven; all but `Oracle` see only windows that
are over, and the speed.
"""

from dataclasses import dataclass, field
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from tuners.recalibration.bank import Bank
from tuners.recalibration.belief import Belief
from tuners.recalibration.doubt import Doubt, doubt
from tuners.recalibration.follower import Follower
from tuners.recalibration.hypotheses import Knowledge
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
        """Gains of the start."""
        return self.start.gains

    def learn(self, before: Course, driven: Driven) -> None:
        """Learn nothing."""


@dataclass(slots=True, eq=False)
class Scheduled(Never):
    """The gains over speed that were right for friction and load at the start."""

    def gains(self, course: Course, coming: Window) -> Array:
        """Gains at the speed to come."""
        return _at_speed(self.drives, self.start.theta, coming)


@dataclass(slots=True, eq=False)
class Late(Never):
    """Knows friction and load of the last window: what no one can do better who cannot foresee."""

    def gains(self, course: Course, coming: Window) -> Array:
        """Gains at the speed to come."""
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
        """Gains at the speed to come; before the first window those of the start."""
        if not self.seen:
            return self.start.gains
        theta = self.drives.estimator.theta(course.start, coming.theta[:, 2])
        return self.drives.designed(theta)

    def learn(self, before: Course, driven: Driven) -> None:
        """The course carries the estimate."""
        self.seen = True


@dataclass(slots=True, eq=False)
class BankMean:
    """The design rule at the bank's mean, which starts from what is known at the start."""

    bank: Bank
    known: Knowledge
    doubts: list[Doubt] = field(default_factory=list)

    def gains(self, course: Course, coming: Window) -> Array:
        """Gains at the speed to come; what is doubted of them is kept."""
        gains = self.bank.gains(self.known, coming.theta[:, 2])
        self.doubts.append(doubt(self.bank, self.known, gains))
        return gains

    def learn(self, before: Course, driven: Driven) -> None:
        """One step of the bank."""
        u = acting(self.bank.drives, before, driven)
        self.known = self.bank.followed(self.known, u, driven.y, driven.theta[:, 2])


@dataclass(slots=True, eq=False)
class Filtered:
    """The design rule at the estimate of a filter that takes the vehicle's data as exact."""

    follower: Follower
    belief: Belief
    x: Array
    near: Array

    @classmethod
    def of(cls, follower: Follower, start: Course) -> Self:
        """Of cars that are known at the start."""
        return cls(follower, follower.known(start.theta), start.predicted, start.start)

    def gains(self, course: Course, coming: Window) -> Array:
        """Gains at the speed to come."""
        return self.follower.gains(self.belief, coming.theta[:, 2])

    def learn(self, before: Course, driven: Driven) -> None:
        """One step of the filter."""
        drives = self.follower.drives
        u, v_x = acting(drives, before, driven), driven.theta[:, 2]
        found, self.x = drives.estimator(u, driven.y, v_x, self.x, self.near)
        self.near = drives.estimator.inside(found.mean)
        self.belief = self.follower.followed(self.belief, found)


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
        """Gains at the speed to come."""
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
        """Gains of the last answer that was usable."""
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


def acting(assumed: Drives, before: Course, driven: Driven) -> Array:
    """Commands (B, N) as they reach the vehicle, for all that is known of its computation delay."""
    late = before.late[:, before.late.shape[1] - assumed.target.delay_samples :]
    joined = np.concatenate([late, driven.u], axis=1)
    return np.ascontiguousarray(joined[:, : driven.u.shape[1]])


def _at_speed(drives: Drives, theta: Array, coming: Window) -> Array:
    """Gains for friction and load of some vehicles (B, 3) at the speeds to come."""
    return drives.designed(np.column_stack([theta[:, :2], coming.theta[:, 2]]))
