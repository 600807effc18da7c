"""Follow cars' friction and load from window to window, and the gains that suit them."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tuners.recalibration.belief import Belief, Motion, follow
from yawrate_env.vehicle.drive_estimate import COORDINATES, Estimate, encode
from yawrate_env.vehicle.drives import Drives

Array = NDArray[np.float64]

_KNOWN = 1e-3  # relative standard deviation of what is known at the start


@dataclass(frozen=True, slots=True)
class Follower:
    """The filter of `belief` for cars that drive as `drives` say.

    Attributes
    ----------
    drives : Drives
        Prior, walk and jumps of friction; the design rule.
    """

    drives: Drives

    @classmethod
    def of(cls, drives: Drives) -> Self:
        """A follower of these drives' cars."""
        return cls(drives)

    def unknown(self, count: int) -> Belief:
        """Beliefs where nothing has been seen: the prior."""
        prior = self.drives.estimator.prior
        covariance = np.tile(np.diag(prior.variance), (count, 1, 1))
        return Belief(np.tile(prior.mean, (count, 1)), covariance, np.zeros(count))

    def known(self, theta: Array) -> Belief:
        """Beliefs where the vehicles (B, 2 or 3) are known, as of cars just calibrated."""
        covariance = np.tile(np.eye(COORDINATES) * _KNOWN**2, (len(theta), 1, 1))
        return Belief(encode(theta, self.drives.vehicle), covariance, np.zeros(len(theta)))

    def loaded(self, belief: Belief) -> Belief:
        """Before another drive: the load is unknown, friction is as it was."""
        prior = self.drives.estimator.prior
        mean, covariance = belief.mean.copy(), belief.covariance.copy()
        mean[:, 1] = prior.mean[1]
        covariance[:, 1], covariance[:, :, 1] = 0.0, 0.0
        covariance[:, 1, 1] = prior.variance[1]
        return Belief(mean, covariance, np.zeros(len(belief)))

    def followed(self, belief: Belief, estimate: Estimate, gap: float | None = None) -> Belief:
        """Beliefs after one more window.

        Parameters
        ----------
        gap : float, optional
            Time since the window before [s]; a window's length if omitted.
        """
        prior, conditions = self.drives.estimator.prior, self.drives.conditions
        if gap is not None:
            conditions = replace(conditions, window=max(gap, conditions.Ts))
        walk = np.zeros((len(belief), COORDINATES))
        walk[:, 0] = (conditions.walk_rms[0] / np.exp(belief.mean[:, 0])) ** 2
        motion = Motion(walk, conditions.jump_probability, 0, prior.mean[0], prior.variance[0])
        found = follow(belief, motion, *estimate.information(prior))
        inside = self.drives.estimator.inside(found.mean)
        return Belief(inside, found.covariance, found.jumped)

    def theta(self, belief: Belief, v_x: Array) -> Array:
        """The vehicles (B, 3) that are most likely, at speeds (B,)."""
        return self.drives.estimator.theta(belief.mean, v_x)

    def gains(self, belief: Belief, v_x: Array) -> Array:
        """Gains (B, 2) of the design rule for them; ``nan`` where it has none."""
        return self.drives.designed(self.theta(belief, v_x))
