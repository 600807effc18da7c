"""Drives of cars whose gains may change between windows: simulation, margins, window estimates.

One window after the other: what it meets (`drive_conditions`), the closed loop (`drive`), the
margins that the gains have on the vehicle as it is in the window, and what the window tells of
friction and load (`drive_estimate`).  Everything is batched over B cars.
"""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.batch import replaced
from yawrate_env.loop.design import Design, Status
from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.loops import Loops
from yawrate_env.loop.target import Target
from yawrate_env.vehicle.discrete import plants
from yawrate_env.vehicle.drive import DriveState, drive
from yawrate_env.vehicle.drive_conditions import Conditions, Integers, Window
from yawrate_env.vehicle.drive_estimate import Estimate, Estimator, LogPrior
from yawrate_env.vehicle.drive_information import Noise
from yawrate_env.vehicle.single_track import Vehicle, context_of

Array = NDArray[np.float64]

_COMMANDS, _YAW_RATES = (-np.pi, np.pi), (-20.0, 20.0)  # that the logger can hold


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Where B drives are: between two windows.

    Attributes
    ----------
    theta : NDArray
        (B, 3) the vehicles of the last window.
    gains : NDArray
        (B, 2) kp and Ti [s] of the last window.
    state : DriveState
        Vehicles, controllers, and steering on its way.
    disturbance : NDArray
        (B,) last steering disturbance [rad].
    late : NDArray
        (B, delay_samples) last commands, oldest first [rad].
    predicted : NDArray
        (B, n) state of the predictor.
    start : NDArray
        (B, 2) coordinates from which the next window's estimate begins.
    """

    theta: Array
    gains: Array
    state: DriveState
    disturbance: Array
    late: Array
    predicted: Array
    start: Array

    def __len__(self) -> int:
        return len(self.theta)

    def replaced(self, rows: NDArray[np.intp], other: "Course") -> "Course":
        """A copy with these rows from another one."""
        return replaced(self, rows, other)


@dataclass(frozen=True, slots=True, eq=False)
class Driven:
    """One window of B drives.

    Attributes
    ----------
    theta : NDArray
        (B, 3) the vehicles.
    gains : NDArray
        (B, 2) in effect.
    reference, u, y : NDArray
        (B, N) as logged [rad/s, rad, rad/s].
    estimate : Estimate
        What the window alone says of friction and load.
    metrics, wanted : NDArray
        (B, 3) phase margin [deg], crossover [Hz] and gain margin [dB] of these gains, and the
        (B, 2) that the design rule reaches on these vehicles.
    stable : NDArray
        (B,) whether the loop is.
    oracle : NDArray
        (B, 2) gains of the design rule; ``nan`` where it has none.
    """

    theta: Array
    gains: Array
    reference: Array
    u: Array
    y: Array
    estimate: Estimate
    metrics: Array
    wanted: Array
    stable: NDArray[np.bool_]
    oracle: Array

    def __len__(self) -> int:
        return len(self.theta)


@dataclass(frozen=True, slots=True)
class Drives:
    """A family of cars, what they meet, and what their loops must reach.

    Attributes
    ----------
    vehicle : Vehicle
        What is known of every car.
    conditions : Conditions
        Prior, friction walk, driving, noise.
    target : Target
        Of the loops; its sampling time is the logger's.
    estimator : Estimator
        What reads the windows.
    gain : float
        Of the yaw-rate sensor, in loop and log.
    """

    vehicle: Vehicle
    conditions: Conditions
    target: Target
    estimator: Estimator = field(repr=False)
    gain: float = 1.0

    @classmethod
    def of(
        cls,
        vehicle: Vehicle | None = None,
        conditions: Conditions | None = None,
        target: Target | None = None,
    ) -> Self:
        """The paper's car unless told otherwise; the estimator knows the conditions' noise."""
        vehicle, conditions = vehicle or Vehicle(), conditions or Conditions()
        for name in ("dead_time", "sensor_lag"):
            validation.number(name, getattr(vehicle, name), at_least=0.0, at_most=0.0,
                              remedy="Drives have none; give delay_samples.")  # fmt: skip
        target = target or Target(Ts=conditions.Ts)
        noise = Noise(conditions.noise, conditions.disturbance, conditions.disturbance_time)
        prior = LogPrior.of(vehicle, conditions)
        return cls(vehicle, conditions, target, Estimator(vehicle, prior, noise, target.Ts))

    def loops(self, theta: Array) -> Loops:
        """Loops around vehicles (B, 3)."""
        found = plants(self.vehicle, context_of(theta), self.target.Ts)
        return Loops.of(replace(found, C=self.gain * found.C), self.target)

    def designed(self, theta: Array) -> Array:
        """Gains (B, 2) of the design rule; ``nan`` where it has none."""
        return _gains(self.loops(theta).design())

    def begin(self, integers: Integers) -> Course:
        """Drives before their first window, with the gains that are right for them.

        Parameters
        ----------
        integers : (B, START_INTEGERS) uint64
            Random.
        """
        theta = self.conditions.begin(integers)
        loops, count = self.loops(theta), len(theta)
        return Course(
            theta,
            _gains(loops.design()),
            DriveState.rest(loops.plant, self.target),
            np.full(count, np.nan),
            np.zeros((count, self.target.delay_samples)),
            self.estimator.states(count),
            np.tile(self.estimator.prior.mean, (count, 1)),
        )

    def coming(self, course: Course, integers: Integers) -> Window:
        """What the next windows meet, from integers (B, WINDOW_INTEGERS)."""
        return self.conditions.window_of(course.theta, integers)

    def window(
        self, course: Course, window: Window, gains: Array, probe: Array | None = None
    ) -> tuple[Course, Driven]:
        """Drive a window with gains (B, 2), and where the drives are then.

        Parameters
        ----------
        probe : (B, N) float64, optional
            Added to the reference [rad/s].
        """
        reference = window.reference if probe is None else window.reference + probe
        loops = self.loops(window.theta)
        disturbance = self.conditions.disturbed(window.white, course.disturbance)
        u, y, state = drive(
            loops.plant, gains, self.target, reference, disturbance, window.noise, course.state
        )
        u, y = np.clip(u, *_COMMANDS), np.clip(y, *_YAW_RATES)
        acting = np.concatenate([course.late, u], axis=1)
        N, v_x = u.shape[1], window.theta[:, 2]
        estimate, predicted = self.estimator(
            np.ascontiguousarray(acting[:, :N]), y, v_x, course.predicted, course.start
        )
        start = self.estimator.inside(estimate.mean)
        design = loops.design()
        found, wanted = loops.evaluate(*gains.T), self._wanted(loops, design)
        margins = found.margins
        metrics = np.stack([margins.phase_margin, margins.crossover, margins.gain_margin], axis=1)
        after = Course(window.theta, gains, state, disturbance[:, -1].copy(),
                       acting[:, N:].copy(), predicted, start)  # fmt: skip
        return after, Driven(window.theta, gains, reference, u, y, estimate, metrics, wanted,
                             found.stable, _gains(design))  # fmt: skip

    def _wanted(self, loops: Loops, design: Design) -> Array:
        """The target, or the margins that the rule reaches where it is out of reach."""
        target = self.target
        wanted = np.tile([target.phase_margin, target.crossover], (len(design.kp), 1))
        short = np.flatnonzero(design.status != Status.OK)
        if len(short):
            plant = _rows(loops.plant, short)
            found = Loops.of(plant, target).evaluate(design.kp[short], design.Ti[short]).margins
            wanted[short] = np.stack([found.phase_margin, found.crossover], axis=1)
        return wanted


def _gains(design: Design) -> Array:
    return np.stack([design.kp, design.Ti], axis=1)


def _rows(plant: DiscretePlant, rows: NDArray[np.intp]) -> DiscretePlant:
    """Some of the plants; all share the output row."""
    D = None if plant.D is None else plant.D[rows]
    delay = None if plant.delay is None else plant.delay[rows]
    return DiscretePlant(plant.A[rows], plant.B[rows], plant.C, plant.Ts, D, delay)
