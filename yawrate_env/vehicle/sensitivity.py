"""Exact sensitivities of the linear vehicles' output to friction and total mass, compiled.

In observer form (see `ObserverForm`), for every parameter theta and with ``s_1 = dy/dtheta``,

    s_i+ = c s_i + s_{i+1} - alpha_i s_1 - (d alpha_i/d theta) y + (d beta_i/d theta) u,

simulated side by side for ``LANES`` vehicles.  Parameters are the logarithms of friction and
total mass.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import LANES, kernel, over_blocks
from yawrate_env.loop.discretisation import zoh_with_sensitivity
from yawrate_env.loop.observer_form import ObserverForm
from yawrate_env.vehicle.single_track import (
    N_STATES,
    Context,
    Vehicle,
    state_space,
    state_space_sensitivity,
    total_mass,
)

Array = NDArray[np.float64]

_LARGEST_STEP = 1.0


@dataclass(frozen=True, slots=True)
class LogSensitivity:
    """Normal equations of the search for friction and mass (`yawrate_env.plant.sensitivity`).

    Attributes
    ----------
    vehicle : Vehicle
        The known parameters.
    Ts : float
        Sampling time [s].
    friction, mass : bool
        Whether each is unknown.
    """

    vehicle: Vehicle
    Ts: float
    friction: bool = True
    mass: bool = True

    def encode(self, theta: Array) -> Array:
        """Parameters (B, 3) to the logarithms of unknown friction and total mass (B, q)."""
        both = np.stack([theta[:, 0], theta[:, 1] + self.vehicle.M_0], axis=1)
        return np.log(both[:, self._unknown])

    def decode(self, z: Array, theta: Array) -> Array:
        """Parameters (B, 3) with the logarithms' values in place of those in `theta`."""
        found = theta.copy()
        values = np.exp(z)
        if self.friction:
            found[:, 0] = values[:, 0]
        if self.mass:
            found[:, 1] = values[:, -1] - self.vehicle.M_0
        return found

    def shortened(self, step: Array) -> Array:
        """Steps (B, q) of at most 1 in each logarithm: no more than a factor e at a time."""
        return np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)

    def gram(self, theta: Array, u: Array, y: Array, rows: NDArray[np.intp]) -> Array:
        """Inner products (R, 1 + q, 1 + q) of output error and slopes over the recordings."""
        chosen = np.array([0, *(1 + np.flatnonzero(self._unknown))])
        whole = output_gram(self.vehicle, Context(*theta.T.copy()), u, y, self.Ts, rows)
        return np.ascontiguousarray(whole[:, chosen[:, None], chosen])

    @property
    def _unknown(self) -> NDArray[np.bool_]:
        return np.array([self.friction, self.mass])


def output_gram(
    vehicle: Vehicle, context: Context, u: Array, y: Array, Ts: float, rows: NDArray[np.intp]
) -> Array:
    """Inner products over an episode of (error, d y/d log mu_s, d y/d log M_veh), (R, 3, 3).

    The error is the measured minus the simulated output [rad/s].

    Parameters
    ----------
    context : Context
        The model of each of R recordings.
    u : (1, N) or (B, N) float64
        Steering commands [rad].
    y : (B, N) float64
        Measured yaw rates [rad/s].
    rows : (R,) int
        Which of the recordings the models belong to.
    """
    A, B, C = state_space(vehicle, context)
    by_log = np.stack([context.mu_s, total_mass(vehicle, context)], axis=1)
    dA = state_space_sensitivity(vehicle, context) * by_log[:, :, None, None]
    plant, dAd, dBd = zoh_with_sensitivity(A, B, C, dA, Ts)
    form = ObserverForm.of(plant)
    by_alpha, by_beta = (d.swapaxes(0, 1) for d in form.sensitivity(plant, dAd, dBd))
    parts = (form.centre[:, None], form.alpha, form.beta, *by_alpha, *by_beta)
    packed = np.concatenate(parts, axis=1)
    gram = np.empty((len(rows), 3, 3))
    width = LANES if len(rows) > 2 else 1

    def one_block(i: int, j: int) -> None:
        lanes = np.minimum(np.arange(i, i + width), j - 1)
        episodes = rows[lanes]
        own = u[episodes] if len(u) > 1 else u
        work = np.zeros((_ROWS, width))
        work[:_STATE] = packed[lanes].T
        _gram(width)(own, y, episodes, work.reshape(-1))
        sums = work[_SUMS:, : j - i]
        upper = np.triu_indices(3)
        gram[i:j, upper[0], upper[1]] = sums.T
        gram[i:j, upper[1], upper[0]] = sums.T

    over_blocks(one_block, len(rows), width)
    return gram


# The flat workspace, in rows of one number a lane: centre, alpha, beta, the two derivatives
# of alpha and of beta, the state and its two sensitivities, the sample's command and
# measurement, and the six sums.  With one array the compiler sees that nothing overlaps
# and vectorises over the lanes.
_N = N_STATES
_ALPHA = 1
_BETA = _ALPHA + _N
_D_ALPHA = _BETA + _N
_D_BETA = _D_ALPHA + 2 * _N
_STATE = _D_BETA + 2 * _N
_COMMAND = _STATE + 3 * _N
_MEASURED = _COMMAND + 1
_SUMS = _MEASURED + 1
_ROWS = _SUMS + 6


@cache
def _gram(lanes: int) -> Any:
    """Compile for a number of lanes; one lane serves a single episode several times faster."""

    @kernel
    def gram(
        u: NDArray[np.float64],
        y: NDArray[np.float64],
        episodes: NDArray[np.int64],
        work: NDArray[np.float64],
    ) -> None:
        for k in range(y.shape[1]):
            for lane in range(lanes):
                work[_MEASURED * lanes + lane] = y[episodes[lane], k]
                work[_COMMAND * lanes + lane] = u[min(lane, len(u) - 1), k]
            for lane in range(lanes):
                c, command = work[lane], work[_COMMAND * lanes + lane]
                output = work[_STATE * lanes + lane]
                s1 = work[(_STATE + _N) * lanes + lane]
                s2 = work[(_STATE + 2 * _N) * lanes + lane]
                e = work[_MEASURED * lanes + lane] - output
                work[_SUMS * lanes + lane] += e * e
                work[(_SUMS + 1) * lanes + lane] += e * s1
                work[(_SUMS + 2) * lanes + lane] += e * s2
                work[(_SUMS + 3) * lanes + lane] += s1 * s1
                work[(_SUMS + 4) * lanes + lane] += s1 * s2
                work[(_SUMS + 5) * lanes + lane] += s2 * s2
                for i in range(_N):
                    alpha = work[(_ALPHA + i) * lanes + lane]
                    at = (_STATE + i) * lanes + lane
                    x = c * work[at] - alpha * output + work[(_BETA + i) * lanes + lane] * command
                    t1 = c * work[at + _N * lanes] - alpha * s1
                    t1 -= work[(_D_ALPHA + i) * lanes + lane] * output
                    t1 += work[(_D_BETA + i) * lanes + lane] * command
                    t2 = c * work[at + 2 * _N * lanes] - alpha * s2
                    t2 -= work[(_D_ALPHA + _N + i) * lanes + lane] * output
                    t2 += work[(_D_BETA + _N + i) * lanes + lane] * command
                    if i + 1 < _N:
                        x += work[at + lanes]
                        t1 += work[at + (_N + 1) * lanes]
                        t2 += work[at + (2 * _N + 1) * lanes]
                    work[at] = x
                    work[at + _N * lanes] = t1
                    work[at + 2 * _N * lanes] = t2

    return gram
