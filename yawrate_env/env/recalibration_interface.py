"""Re-calibration between drives and agents: what is observed, chosen, rewarded and told.

Everything is batched; the scalar environment is a batch of one.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.env.interface import Array, Info, Observation
from yawrate_env.plant.action_bounds import action_bounds
from yawrate_env.plant.parametrisation import loop, scale_to_bounds
from yawrate_env.plant.pi_loop import CROSSOVER_SCALE, PHASE_SCALE
from yawrate_env.plant.plant import Plant
from yawrate_env.plant.reward import UNSTABLE, defined, reward
from yawrate_env.signals.excitation import prbs
from yawrate_env.vehicle.drive_conditions import Integers, Window
from yawrate_env.vehicle.drive_estimate import Estimate
from yawrate_env.vehicle.drives import Course, Driven, Drives
from yawrate_env.vehicle.single_track import CONTEXT, check_parameter
from yawrate_env.vehicle.task import Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

FEATURES = 9
SAFE_MARGIN = 45.0
"""Phase margin [deg] below which a window has a cost."""

_MARGINS = "phase_margin", "crossover", "gain_margin"
_LIMIT = 10.0  # of features
_SCALES = np.array([PHASE_SCALE, CROSSOVER_SCALE])
_PROBE_BIT = 0.2  # s
_LEAST_PROBE = 1e-6  # rad/s, which PRBS of the zeroth amplitude have


@dataclass(frozen=True, slots=True, eq=False)
class RecalibrationInterface:
    """What an agent observes of drives, and what it chooses.

    Attributes
    ----------
    drives : Drives
        Cars, what they meet, and their loops' target.
    plant : Plant
        The same cars as a plant, with metrics and rule.
    windows : int
        Of a drive.
    price : float
        Of new gains, in reward.
    probing : float
        Largest amplitude of a probing signal on the reference [rad/s]; 0 leaves it out.
    comfort : float
        Price of lateral acceleration in reward per m/s^2 (root mean square); only with probing.
    low, high : NDArray
        (2,) the controller's log magnitude and phase [rad] at the crossover, for actions -1 and 1.
    """

    drives: Drives
    plant: Plant
    windows: int
    price: float
    probing: float
    comfort: float
    low: Array
    high: Array

    @classmethod
    def of(cls, drives: Drives, *, windows: Any, price: Any, probing: Any, comfort: Any) -> Self:
        """Check the settings, and take the range of gains that the rule gives for the prior."""
        remedy = "Use SI units."
        count = validation.count("windows", windows, at_least=1, at_most=1e6,
                                 remedy="Drive for some minutes.")  # fmt: skip
        validation.number("price", price, at_least=0.0, at_most=10.0, remedy="Give a reward.")
        validation.number("probing", probing, at_least=0.0, at_most=1.0, remedy=remedy)
        validation.number("comfort", comfort, at_least=0.0, at_most=10.0, remedy="Give a reward.")
        given = drives.conditions
        prior = Prior(given.mu_s, given.M_delta, given.v_x)
        task = Task(drives.vehicle, prior, target=drives.target)
        plant = yaw_rate(task, check=False)
        low, high = action_bounds(plant)
        return cls(drives, plant, count, float(price), float(probing), float(comfort), low, high)

    @property
    def observation_space(self) -> Box:
        """Features of the last window, gains in effect, and speed."""
        return Box(-_LIMIT, _LIMIT, (FEATURES,), dtype=np.float32)

    @property
    def action_space(self) -> Box:
        """Two coordinates of the gains, whether to change, and the amplitude of probing."""
        return Box(-1.0, 1.0, (3 + (self.probing > 0),), dtype=np.float32)

    def pins(self, options: Mapping[str, Any], count: int) -> dict[str, Array]:
        """Parameters (count,) at a drive's start that the options of ``reset`` pin, checked."""
        pins: dict[str, Array] = {}
        for name, value in options.items():
            validation.one_of("reset option", name, CONTEXT)
            values = validation.float_array(f"reset option {name}", value)
            if values.shape not in ((), (1,), (count,)):
                raise ValueError(
                    f"reset option {name} has shape {values.shape}. Give one number"
                    + (f", or {count}." if count > 1 else ".")
                )
            for one in values.flat:
                check_parameter(name, float(one))
            pins[name] = np.broadcast_to(values, (count,))
        return pins

    def begin(
        self, starts: Integers, first: Integers, then: Integers, pins: Mapping[str, Array]
    ) -> tuple[Course, Window, Observation]:
        """Drives after one window with gains that suit them, and what the next one meets.

        Parameters
        ----------
        starts : (B, START_INTEGERS) uint64
            Random, for the vehicles.
        first, then : (B, WINDOW_INTEGERS) uint64
            For the first window, in which nothing moves yet, and the one to come.
        """
        drives = self.drives
        course = drives.begin(starts)
        if pins:
            theta = course.theta.copy()
            for i, name in enumerate(CONTEXT):
                if name in pins:
                    theta[:, i] = pins[name]
            course = replace(course, theta=theta, gains=drives.designed(theta))
        window = replace(drives.coming(course, first), theta=course.theta)
        course, driven = drives.window(course, window, course.gains)
        coming = drives.coming(course, then)
        return course, coming, self.observation(driven.estimate, course.gains, coming)

    def step(
        self, course: Course, window: Window, actions: Array, integers: Integers
    ) -> tuple[Course, Window, Observation, Array, Info]:
        """Drive a window, and observe it.

        Returns
        -------
        course, coming, observation
            As of `begin`.
        reward : (B,) float64
        info : dict
            The truth, arrays (B,).
        """
        chosen, changed = self.chosen(actions), actions[:, 2] > 0
        gains = np.where(changed[:, None], chosen, course.gains)
        changed &= (gains != course.gains).any(axis=1)
        probe = self._probe(actions)
        course, driven = self.drives.window(course, window, gains, probe)
        coming = self.drives.coming(course, integers)
        obs = self.observation(driven.estimate, gains, coming)
        return course, coming, obs, *self.outcome(driven, changed)

    def chosen(self, actions: NDArray[np.floating]) -> Array:
        """Gains (B, 2) of actions (B, 3 or 4)."""
        values = scale_to_bounds(actions[:, :2], self.low, self.high)
        return loop(self.drives.target).decode(values)

    def actions(self, gains: Array) -> Array:
        """Actions (B, 3 or 4) that put gains (B, 2) into effect; keep them where they are `nan`."""
        values = loop(self.drives.target).encode(gains)
        unit = 2 * (values - self.low) / (self.high - self.low) - 1
        known = np.isfinite(unit).all(axis=1)
        actions = np.full((len(gains), *self.action_space.shape), -1.0)
        actions[known, :2] = np.clip(unit[known], -1, 1)
        actions[:, 2] = np.where(known, 1.0, -1.0)
        return actions

    def observation(self, estimate: Estimate, gains: Array, coming: Window) -> Observation:
        """Features (B, 9) of the last windows, the gains in effect, and the speed to come."""
        prior, N = self.drives.estimator.prior, self.drives.conditions.samples
        spread = np.sqrt(np.stack([estimate.covariance[:, i, i] for i in range(2)], axis=1))
        deviation = np.sqrt(prior.variance)
        excess = (estimate.misfit - N) / np.sqrt(2 * N)
        values = loop(self.drives.target).encode(gains)
        low, high = self.drives.conditions.v_x
        features = np.column_stack([
            (estimate.mean - prior.mean) / deviation,
            np.log(spread / deviation),
            estimate.covariance[:, 0, 1] / spread.prod(axis=1),
            np.sign(excess) * np.log1p(np.abs(excess)),
            2 * (values - self.low) / (self.high - self.low) - 1,
            2 * (coming.theta[:, 2] - low) / (high - low) - 1 if high > low else 0 * excess,
        ])  # fmt: skip
        finite = np.nan_to_num(features, nan=0.0, posinf=_LIMIT, neginf=-_LIMIT)
        return np.asarray(np.clip(finite, -_LIMIT, _LIMIT), dtype=np.float32)

    def estimates(self, obs: NDArray[np.floating]) -> Estimate:
        """What observations (B, 9) say of the windows before them."""
        prior, N = self.drives.estimator.prior, self.drives.conditions.samples
        values = obs.astype(np.float64)
        deviation = np.sqrt(prior.variance)
        spread = deviation * np.exp(values[:, 2:4])
        covariance = spread[:, :, None] * spread[:, None]
        for i, j in ((0, 1), (1, 0)):
            covariance[:, i, j] *= values[:, 4]
        excess = np.sign(values[:, 5]) * np.expm1(np.abs(values[:, 5]))
        misfit = N + np.sqrt(2 * N) * excess
        return Estimate(prior.mean + deviation * values[:, :2], covariance, misfit)

    def speeds(self, obs: NDArray[np.floating]) -> Array:
        """Speeds (B,) [m/s] of the windows to come."""
        low, high = self.drives.conditions.v_x
        return np.asarray(low + (high - low) * (obs[:, 8].astype(np.float64) + 1) / 2)

    def gains(self, obs: NDArray[np.floating]) -> Array:
        """Gains (B, 2) in effect, from observations (B, 9)."""
        unit = (obs[:, 6:8].astype(np.float64) + 1) / 2
        return loop(self.drives.target).decode(self.low + (self.high - self.low) * unit)

    def _probe(self, actions: Array) -> Array | None:
        if not self.probing:
            return None
        given = self.drives.conditions
        (bits,) = prbs(given.samples, given.Ts, max(_PROBE_BIT, given.Ts), _LEAST_PROBE)
        share = np.clip(actions[:, 3], 0.0, 1.0)
        return np.asarray((self.probing / _LEAST_PROBE) * share[:, None] * bits)

    def outcome(self, driven: Driven, changed: NDArray[np.bool_]) -> tuple[Array, Info]:
        """Rewards (B,) of windows, and the truth, where gains changed (B,) or not."""
        errors = defined(driven.metrics[:, :2], driven.stable) - driven.wanted
        earned = reward(errors / _SCALES) - self.price * changed
        if self.probing:
            lateral = driven.y * driven.theta[:, 2:]
            earned = earned - self.comfort * np.sqrt((lateral**2).mean(axis=1))
        return np.where(driven.stable, earned, UNSTABLE), _info(driven, changed)


def _info(driven: Driven, changed: NDArray[np.bool_]) -> Info:
    """What is told after a window, arrays (B,)."""
    phase_margin = driven.metrics[:, 0]
    return {
        **dict(zip(("kp", "Ti"), driven.gains.T, strict=True)),
        "changed": changed,
        **dict(zip(_MARGINS, driven.metrics.T, strict=True)),
        "stable": driven.stable,
        **dict(zip(("oracle_kp", "oracle_Ti"), driven.oracle.T, strict=True)),
        **dict(zip(CONTEXT, driven.theta.T, strict=True)),
        "cost": np.where(driven.stable & (phase_margin >= SAFE_MARGIN), 0.0, 1.0),
    }
