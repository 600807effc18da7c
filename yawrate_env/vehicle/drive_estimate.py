"""Friction and load as one window of driving tells them: a mean and a covariance for each car.

Coordinates z are the logarithms of friction and total mass.  With a normal prior and the predictor
of `yawrate_env.vehicle.drive_information`, which gives prediction errors e and slopes, a
Gauss-Newton step from z ends in

    mean = z + covariance (slopes' e + precision (m - z)),   covariance = (F + precision)^-1

where F is the information of the window.  Whoever combines windows takes the prior out again
(`Estimate.information`).
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env.batch import replaced
from yawrate_env.vehicle.drive_conditions import Conditions
from yawrate_env.vehicle.drive_information import Noise, Predictor
from yawrate_env.vehicle.single_track import Vehicle

Array = NDArray[np.float64]

COORDINATES = 2

NEAR = 1.5
"""Length of a step, in posterior standard deviations, within which slopes hardly change."""

_GRID = 4001


@dataclass(frozen=True, slots=True, eq=False)
class LogPrior:
    """Uniform friction and load, as coordinates have them.

    Attributes
    ----------
    mean, variance : NDArray
        (2,) of the coordinates.
    low, high : NDArray
        (2,) their ends.
    """

    mean: Array
    variance: Array
    low: Array
    high: Array

    @classmethod
    def of(cls, vehicle: Vehicle, conditions: Conditions) -> Self:
        """Moments of the logarithms of what is uniform; a number counts as known to 0.1 %."""
        low, high = (end[:COORDINATES] for end in conditions.ends)
        middle = (np.arange(_GRID) + 0.5) / _GRID
        values = encode(low + np.outer(middle, high - low), vehicle)
        ends = encode(np.stack([low, high]), vehicle)
        return cls(values.mean(axis=0), np.maximum(values.var(axis=0), 1e-6), *ends)


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """What B windows say.

    Attributes
    ----------
    mean, covariance : NDArray
        (B, 2), (B, 2, 2), with the prior.
    misfit : NDArray
        (B,) sum of squared prediction errors at the mean, in units of the noise: N on average.
    """

    mean: Array
    covariance: Array
    misfit: Array

    def __len__(self) -> int:
        return len(self.mean)

    def information(self, prior: LogPrior) -> tuple[Array, Array]:
        """Information of the windows alone: matrices F (B, 2, 2), and F times their mean (B, 2)."""
        precision = _inverse(self.covariance)
        whole = (precision * self.mean[:, None]).sum(axis=2)
        return precision - np.diag(1 / prior.variance), whole - prior.mean / prior.variance


@dataclass(frozen=True, slots=True)
class Estimator:
    """Estimates of vehicles that differ in friction, load and speed.

    Attributes
    ----------
    vehicle : Vehicle
        What is known.
    prior : LogPrior
        Of friction and load.
    noise : Noise
        What moves the yaw rate beside the command.
    Ts : float
        Sampling time of the logger [s].
    """

    vehicle: Vehicle
    prior: LogPrior
    noise: Noise
    Ts: float

    def states(self, count: int) -> Array:
        """Predictor states (B, n) of straight driving."""
        return np.zeros((count, 7))

    def __call__(
        self, u: Array, y: Array, v_x: Array, x: Array, start: Array, steps: int = 2
    ) -> tuple[Estimate, Array]:
        """Estimates, and the predictor's states for the next window.

        Parameters
        ----------
        u, y : (B, N) float64
            Command as it reaches the vehicle [rad], measured yaw rate [rad/s].
        v_x : (B,) float64
            Speed [m/s].
        x : (B, n) float64
            States that the window before ended with.
        start : (B, 2) float64
            Coordinates to begin from.
        steps : int
            Gauss-Newton steps at most: windows whose step leads less than `NEAR` standard
            deviations away need no further one.
        """
        here = self._step(u, y, v_x, x, start)
        for _ in range(steps - 1):
            rows = np.flatnonzero(here.length > NEAR)
            if not len(rows):
                break
            z, gain = self.inside(here.estimate.mean[rows]), (here.gain[rows], here.variance[rows])
            again = self._step(u[rows], y[rows], v_x[rows], x[rows], z, gain)
            here = again if len(rows) == len(u) else replaced(here, rows, again)
        return here.estimate, here.after

    def _step(
        self,
        u: Array,
        y: Array,
        v_x: Array,
        x: Array,
        z: Array,
        gain: tuple[Array, Array] | None = None,
    ) -> "_Step":
        """One Gauss-Newton step from coordinates z (B, 2)."""
        prior = self.prior
        predictor = Predictor.of(self.vehicle, self.theta(z, v_x), self.noise, self.Ts, gain)
        gram, after = predictor.gram(u, y, x)
        slope, F = gram[:, 1:, 0], gram[:, 1:, 1:]
        precision = F + np.diag(1 / prior.variance)
        covariance = _inverse(precision)
        pull = slope + (prior.mean - z) / prior.variance
        step = (covariance * pull[:, None]).sum(axis=2)
        curved = (F * step[:, None]).sum(axis=2)
        misfit = gram[:, 0, 0] + ((curved - 2 * slope) * step).sum(axis=1)
        length = np.sqrt(np.maximum((pull * step).sum(axis=1), 0.0))
        found = Estimate(z + step, covariance, misfit)
        return _Step(found, after, predictor.K, predictor.variance, length)

    def inside(self, z: Array) -> Array:
        """The nearest coordinates (B, 2) within the prior's ends."""
        return np.clip(z, self.prior.low, self.prior.high)

    def theta(self, z: Array, v_x: Array) -> Array:
        """Coordinates (B, 2) and speeds (B,) as parameters (B, 3)."""
        values = np.exp(z)
        return np.stack([values[:, 0], values[:, 1] - self.vehicle.M_0, v_x], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """A step's end, predictor states, Kalman gains, variances, and lengths in deviations."""

    estimate: Estimate
    after: Array
    gain: Array
    variance: Array
    length: Array


def encode(theta: Array, vehicle: Vehicle) -> Array:
    """Parameters (B, 2 or 3) as coordinates (B, 2)."""
    return np.log(np.stack([theta[:, 0], theta[:, 1] + vehicle.M_0], axis=1))


def _inverse(matrices: Array) -> Array:
    return np.asarray(np.linalg.inv(matrices), dtype=np.float64)
