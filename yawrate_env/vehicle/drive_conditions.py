"""Conditions of drives: friction that walks and jumps, speed, manoeuvres, noise, disturbance.

Vehicles are parameters (B, 3), friction, extra mass [kg] and speed [m/s], constant over a window
and changed between windows.  Friction and speed are random walks between reflecting ends; friction
also jumps, at a rate of its own, to anywhere in its range.  The load changes between drives only.
All that is random comes from 64-bit integers of each vehicle and window, so that no drive depends
on the batch that it is in.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.compiled import kernel
from yawrate_env.plant.distributions import Range
from yawrate_env.signals.noise import KEY_WORDS, standard_normal
from yawrate_env.signals.streams import uniform
from yawrate_env.vehicle.manoeuvre import lane_change, step
from yawrate_env.vehicle.single_track import CONTEXT, check_parameter

Array = NDArray[np.float64]
Integers = NDArray[np.uint64]

START_INTEGERS = 3
"""Random integers that a drive's first vehicle takes."""

_JUMP, _TO, _KIND, _SIDE, _HEIGHT, _BEGIN, _RAMP, _LENGTH = range(8)
WINDOW_INTEGERS = 8 + KEY_WORDS
"""Random integers that a window takes."""

_WALKS = 2  # normal numbers of a window for friction and speed, before those for its samples
_MINUTE = 60.0


@dataclass(frozen=True)
class Conditions:
    """How the road, the car, its driver and its sensors are from window to window.

    Attributes
    ----------
    mu_s, M_delta, v_x : tuple of float
        Ranges of friction, extra mass [kg] and speed [m/s].
    friction_walk : float
        Root mean square change of friction in a minute, without jumps.
    jump_every : float
        Mean time between jumps of friction [s].
    speed_walk : float
        Root mean square change of speed in a minute [m/s].
    yaw_rate : tuple of float
        Range of the references' heights [rad/s]; lateral acceleration limits them, too.
    acceleration : float
        Largest lateral acceleration of a reference [m/s^2].
    lane_changes : float
        Share of windows with a lane change; the others have a step.
    noise : float
        Standard deviation of the gyro's white noise [rad/s].
    disturbance : float
        Root mean square of the steering disturbance, coloured by a first-order lag [rad].
    disturbance_time : float
        Its time constant [s].
    window : float
        Length of a window [s].
    Ts : float
        Sampling time of controller and logger [s].
    """

    mu_s: Range = (0.3, 1.1)
    M_delta: Range = (0.0, 300.0)
    v_x: Range = (10.0, 33.0)
    friction_walk: float = 0.02
    jump_every: float = 300.0
    speed_walk: float = 3.0
    yaw_rate: Range = (0.02, 0.1)
    acceleration: float = 3.0
    lane_changes: float = 0.5
    noise: float = float(np.radians(0.1))
    disturbance: float = float(np.radians(0.05))
    disturbance_time: float = 0.15
    window: float = 5.0
    Ts: float = 0.01

    def __post_init__(self) -> None:
        for name in CONTEXT:
            low, high = validation.interval(name, getattr(self, name))
            for end in (low, high):
                check_parameter(name, end, "Use SI units, and a range within this bound.")
            object.__setattr__(self, name, (low, high))
        for name in ("friction_walk", "speed_walk", "noise", "disturbance"):
            validation.number(name, getattr(self, name), at_least=0.0, remedy="Use SI units.")
        for name in ("jump_every", "disturbance_time", "acceleration", "window", "Ts"):
            validation.number(name, getattr(self, name), above=0.0, remedy="Use SI units.")
        validation.number("lane_changes", self.lane_changes, at_least=0.0, at_most=1.0,
                          remedy="Give a share.")  # fmt: skip

    @cached_property
    def samples(self) -> int:
        """Samples of a window, N."""
        return max(2, round(self.window / self.Ts))

    @cached_property
    def ends(self) -> tuple[Array, Array]:
        """Lowest and highest parameters, (3,) each."""
        low, high = np.array([getattr(self, name) for name in CONTEXT]).T
        return low, high

    @cached_property
    def jump_probability(self) -> float:
        """That friction jumps between two windows."""
        return float(-np.expm1(-self.window / self.jump_every))

    @cached_property
    def walk_rms(self) -> Array:
        """Root mean square steps of the parameters between two windows, (3,)."""
        rms = np.array([self.friction_walk, 0.0, self.speed_walk])
        return np.asarray(rms * np.sqrt(self.window / _MINUTE))

    def begin(self, integers: Integers) -> Array:
        """Parameters (B, 3) at the start of a drive from integers (B, `START_INTEGERS`)."""
        low, high = self.ends
        return np.asarray(low + (high - low) * uniform(integers))

    def window_of(self, theta: Array, integers: Integers) -> "Window":
        """The next window of vehicles (B, 3) from integers (B, `WINDOW_INTEGERS`)."""
        unit, N = uniform(integers[:, :-KEY_WORDS]), self.samples
        normal = standard_normal(integers[:, -KEY_WORDS:], _WALKS + 2 * N)
        moved = self._moved(theta, unit, normal)
        noise = self.noise * normal[:, _WALKS : _WALKS + N]
        return Window(moved, self._reference(moved, unit), normal[:, _WALKS + N :], noise)

    def disturbed(self, white: Array, last: Array) -> Array:
        """Steering disturbance (B, N) [rad] of white noise (B, N).

        Parameters
        ----------
        last : (B,) float64
            Where it was a sample before; ``nan`` begins anywhere.
        """
        out = np.empty_like(white)
        share = np.exp(-self.Ts / self.disturbance_time)
        _coloured(white, last, share, self.disturbance, out)
        return out

    def _moved(self, theta: Array, unit: Array, normal: Array) -> Array:
        low, high = self.ends
        moved = theta.copy()
        moved[:, [0, 2]] += self.walk_rms[[0, 2]] * normal[:, :_WALKS]
        moved = _reflected(moved, low, high)
        jumps = unit[:, _JUMP] < self.jump_probability
        moved[jumps, 0] = (low[0] + (high[0] - low[0]) * unit[:, _TO])[jumps]
        return moved

    def _reference(self, theta: Array, unit: Array) -> Array:
        """A step or a lane change (B, N) that ends within the window."""
        low, high = self.yaw_rate
        height = np.minimum(low + (high - low) * unit[:, _HEIGHT], self.acceleration / theta[:, 2])
        height *= np.where(unit[:, _SIDE] < 0.5, -1.0, 1.0)
        begin = (0.02 + 0.18 * unit[:, _BEGIN]) * self.window
        held = (0.3 + 0.3 * unit[:, _LENGTH]) * self.window
        time = self.Ts * np.arange(self.samples, dtype=np.float64)
        ramp = 0.08 * unit[:, _RAMP] * self.window
        lanes = unit[:, _KIND] < self.lane_changes
        reference, bends = np.empty((len(theta), self.samples)), ~lanes
        reference[lanes] = lane_change(time, height[lanes], begin[lanes], held[lanes])
        reference[bends] = step(time, height[bends], begin[bends], ramp[bends], held[bends])
        return reference


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """What B vehicles meet in one window.

    Attributes
    ----------
    theta : NDArray
        (B, 3) the vehicles.
    reference : NDArray
        (B, N) yaw-rate reference [rad/s].
    white : NDArray
        (B, N) standard normal numbers behind the steering disturbance.
    noise : NDArray
        (B, N) of the gyro [rad/s].
    """

    theta: Array
    reference: Array
    white: Array
    noise: Array


def _reflected(values: Array, low: Array, high: Array) -> Array:
    """Values (B, p) folded back into their ranges."""
    width = np.maximum(high - low, 1e-300)
    away = np.abs((values - low) % (2 * width))
    return np.where(high > low, low + np.minimum(away, 2 * width - away), low)


@kernel
def _coloured(
    white: NDArray[np.float64],
    last: NDArray[np.float64],
    share: float,
    rms: float,
    out: NDArray[np.float64],
) -> None:
    """First-order autoregression, row by row, stationary with this root mean square."""
    fresh = rms * np.sqrt(1.0 - share * share)
    for b in range(len(white)):
        value = last[b]
        for k in range(white.shape[1]):
            value = share * value + fresh * white[b, k]
            if k == 0 and np.isnan(value):
                value = rms * white[b, 0]
            out[b, k] = value
