"""Prediction-error identification of (mu_s, M_delta).

The sum of squared output errors from rest (the noise is white, so this is the
prediction error) is minimised by damped Gauss-Newton steps from the middle of the
prior, in the logarithms of friction and total mass, with exact output sensitivities.
In observer form (see `ObserverForm`), for every parameter theta and with ``s_1 = dy/dtheta``,

    s_i+ = c s_i + s_{i+1} - alpha_i s_1 - (d alpha_i/d theta) y + (d beta_i/d theta) u,

simulated side by side for ``LANES`` vehicles.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import LANES, kernel, over_blocks
from yawrate_env.loop.discretisation import ObserverForm, zoh_with_sensitivity
from yawrate_env.vehicle.single_track import (
    N_STATES,
    Context,
    Vehicle,
    state_space,
    state_space_sensitivity,
    total_mass,
)

Array = NDArray[np.float64]

_MAX_STEPS = 40
_TOLERANCE = 1e-10
_ROUNDING = 1e-24  # of the output's energy: without noise the cost ends here
_LARGEST_STEP = 1.0  # in the logarithm: no more than a factor e at a time


@dataclass(frozen=True, slots=True, eq=False)
class Identified:
    """Identified vehicles, (B,) each.

    Attributes
    ----------
    context : Context
        Friction and mass found, speed as given.
    cost : NDArray
        Mean squared output error [(rad/s)^2].
    converged : NDArray
        Whether the last step promised nothing more, and the data depend on both parameters.
    steps : NDArray
        Simulations with sensitivities that it took.
    """

    context: Context
    cost: Array
    converged: NDArray[np.bool_]
    steps: NDArray[np.int64]


def identify(
    vehicle: Vehicle,
    u: Array,
    y: Array,
    Ts: float,
    start: Context,
    v_x: Array,
    unknown: tuple[bool, bool] = (True, True),
) -> Identified:
    """Find friction and mass of every episode.

    Parameters
    ----------
    u : (1, N) or (B, N) float64
        Steering commands [rad].
    y : (B, N) float64
        Yaw rates [rad/s].
    Ts : float
        Sampling time [s].
    start : Context
        One vehicle, where the search starts.
    v_x : (B,) float64
        Speeds [m/s].
    unknown : tuple of bool
        Whether friction and mass are; what is known stays as it starts.
    """
    fixed = ~np.array(unknown)
    count = len(y)
    theta = np.tile([np.log(start.mu_s[0]), np.log(total_mass(vehicle, start)[0])], (count, 1))
    best = np.full(count, np.inf)
    normal, slope = np.zeros((count, 2, 2)), np.zeros((count, 2))
    damping = np.full(count, 1e-6)
    step = np.zeros((count, 2))
    converged, steps = np.zeros(count, dtype=bool), np.zeros(count, dtype=np.int64)
    rounding = _ROUNDING * np.einsum("bn,bn->b", y, y)
    active = np.arange(count)
    for _ in range(_MAX_STEPS):
        trial = theta[active] + step[active]
        gram = output_gram(vehicle, _context(vehicle, trial, v_x[active]), u, y, Ts, active)
        steps[active] += 1
        better = gram[:, 0, 0] < best[active]
        to, frm = active[better], np.flatnonzero(better)
        gained = np.where(better, best[active] - gram[:, 0, 0], 0.0)
        theta[to], best[to] = trial[frm], gram[frm, 0, 0]
        slope[to], normal[to] = gram[frm, 0, 1:], gram[frm, 1:, 1:]
        slope[:, fixed] = normal[:, fixed] = normal[:, :, fixed] = 0.0
        normal[:, fixed, fixed] = 1.0
        damping[active] = np.where(better, damping[active] * 0.1, damping[active] * 100)
        lifted = normal[active] * (1 + damping[active, None, None] * np.eye(2))
        step[active] = _solve_2x2(lifted, slope[active])
        promised = np.einsum("bi,bi->b", step[active], slope[active])
        step[active] = np.clip(step[active], -_LARGEST_STEP, _LARGEST_STEP)
        done = promised < _TOLERANCE * best[active] + rounding[active]
        done &= gained < 1e-4 * best[active] + rounding[active]
        converged[active[done]] = normal[active[done]].diagonal(axis1=1, axis2=2).all(axis=1)
        active = active[~done & (damping[active] < 1e8) & np.isfinite(best[active])]
        if not len(active):
            break
    return Identified(_context(vehicle, theta, v_x), best / y.shape[1], converged, steps)


def output_gram(
    vehicle: Vehicle, context: Context, u: Array, y: Array, Ts: float, rows: NDArray[np.intp]
) -> Array:
    """Inner products over an episode of (error, d y/d log mu_s, d y/d log M_veh).

    The error is the measured minus the simulated output [rad/s].

    Parameters
    ----------
    context : Context
        The model of each of R rows.
    rows : (R,) int
        Which episodes of the recording they are compared with.

    Returns
    -------
    (R, 3, 3)
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


def _context(vehicle: Vehicle, theta: Array, v_x: Array) -> Context:
    mu_s, mass = np.exp(theta).T
    return Context(mu_s.copy(), mass - vehicle.M_0, v_x)


def _solve_2x2(H: Array, g: Array) -> Array:
    determinant = H[:, 0, 0] * H[:, 1, 1] - H[:, 0, 1] * H[:, 1, 0]
    safe = np.where(determinant > 0, determinant, np.inf)
    return np.stack(
        [
            (H[:, 1, 1] * g[:, 0] - H[:, 0, 1] * g[:, 1]) / safe,
            (H[:, 0, 0] * g[:, 1] - H[:, 1, 0] * g[:, 0]) / safe,
        ],
        axis=1,
    )


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
