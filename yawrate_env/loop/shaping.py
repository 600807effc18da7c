"""Rules for any linear plant: a largest sensitivity for PI and PID, LQR, and a lead or a lag.

Loop shaping by rule R is in `yawrate_env.loop.law`, rules for processes are in
`yawrate_env.loop.process_rules`.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.transfer_function import TransferFunction

Array = NDArray[np.float64]

_DECADES, _A_DECADE = 4, 25  # frequencies, below the Nyquist frequency
_SHORTEST, _LONGEST, _TIMES = 2.0, 2e4, 21  # integral times tried, in samples
_ZOOM, _ROUNDS = 9, 4
_DOUBLINGS = 60


def largest_gain(loop: TransferFunction, Ms: float) -> Array:
    """Largest factors (B,) with which the loops' sensitivity stays at or below `Ms`.

    For loops that a small factor leaves stable.  At each frequency ``|1 + k L| >= 1/Ms`` up to
    the smaller root of a quadratic equation in k; the least of these is looked for on a grid,
    and refined.
    """
    top, c = np.log(np.pi / loop.Ts), 1 - 1 / Ms**2

    def reciprocal(x: Array) -> Array:
        L = loop(np.exp(x))
        inside = L.real**2 - c * np.abs(L) ** 2
        limited = (L.real < 0) & (inside >= 0)
        return np.where(limited, (-L.real + np.sqrt(np.where(limited, inside, 0.0))) / c, 0.0)

    count = _DECADES * _A_DECADE + 1
    grid = np.linspace(top - _DECADES * np.log(10), top, count)[None].repeat(len(loop.num), axis=0)
    with np.errstate(divide="ignore"):
        return np.asarray(1 / _highest(reciprocal, grid)[1])


def constrained(
    unit: Callable[[Array], TransferFunction], count: int, Ms: float, Ts: float
) -> Array:
    """Gains kp and Ti (B, 2) with the largest kp/Ti whose sensitivity stays at or below `Ms`.

    The largest integral gain rejects disturbances best: Astrom, Panagopoulos and Hagglund,
    Automatica 34, 1998.

    Parameters
    ----------
    unit : callable
        ``unit(Ti)``: integral times (B,) to open loops with kp = 1.
    count : int
        B.
    Ts : float
        Sampling time [s].
    """

    def integral_gain(x: Array) -> Array:
        Ti = np.exp(x)
        return np.stack([largest_gain(unit(t), Ms) / t for t in Ti.T], axis=1)

    tried = np.log(Ts * np.geomspace(_SHORTEST, _LONGEST, _TIMES))
    x, _ = _highest(integral_gain, tried[None].repeat(count, axis=0))
    Ti = np.exp(x)
    return np.stack([largest_gain(unit(Ti), Ms), Ti], axis=1)


def _highest(function: Callable[[Array], Array], grid: Array) -> tuple[Array, Array]:
    """Where functions of (B, F) are highest, and how high, (B,) each."""
    for _ in range(_ROUNDS):
        values = function(grid)
        at = np.clip(values.argmax(axis=1), 1, grid.shape[1] - 2)
        rows = np.arange(len(grid))
        low, high = grid[rows, at - 1], grid[rows, at + 1]
        last = grid, values, at
        grid = np.linspace(low, high, _ZOOM, axis=1)
    grid, values, at = last
    left, middle, right = (values[rows, at + i] for i in (-1, 0, 1))
    bend = left - 2 * middle + right
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(bend < 0, np.clip((left - right) / (2 * bend), -1, 1), 0.0)
    x = grid[rows, at] + share * (grid[rows, at + 1] - grid[rows, at])
    return x, middle - (left - right) * share / 4


def lqr(plant: DiscretePlant, weight: float) -> Array:
    """Gains (B, n) of the states that minimise the sum of ``y^2 + weight u^2``.

    The Riccati equation by structure-preserving doubling (Chu, Fan, Lin and Wang, Int. J.
    Control 77, 2004), which converges quadratically; ``nan`` where it does not.
    """
    n = plant.A.shape[1]
    C = np.broadcast_to(plant.C, (len(plant), n))
    A, one = plant.A, np.eye(n)
    G = plant.B[:, :, None] * plant.B[:, None, :] / weight
    H = C[:, :, None] * C[:, None, :]
    for _ in range(_DOUBLINGS):
        W = np.linalg.inv(one + G @ H)
        AW, before = A @ W, H
        H = H + A.swapaxes(1, 2) @ H @ W @ A
        G = G + AW @ G @ A.swapaxes(1, 2)
        A = AW @ A
        if np.allclose(H, before, rtol=1e-13, atol=0.0):
            break
    HB = np.einsum("bij,bj->bi", H, plant.B)
    K = np.einsum("bi,bij->bj", HB, plant.A)
    K /= (weight + np.einsum("bi,bi->b", plant.B, HB))[:, None]
    closed = plant.A - plant.B[:, :, None] * K[:, None, :]
    stable = np.asarray((np.abs(np.linalg.eigvals(closed)) < 1).all(axis=1))
    return np.where(stable[:, None], K, np.nan)


def lead_lag(log_magnitude: Array, phase: Array, omega: float) -> Array:
    """Gains kp, T_lead, T_lag (B, 3) with this response at `omega` [rad/s], centred there.

    ``nan`` where the phase is not between -90 and 90 degrees.
    """
    reachable = np.abs(phase) < np.pi / 2
    sine = np.sin(np.where(reachable, phase, np.nan))
    root = np.sqrt((1 + sine) / (1 - sine))
    return np.stack([np.exp(log_magnitude) / root, root / omega, 1 / (root * omega)], axis=1)
