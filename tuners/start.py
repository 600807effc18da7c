"""Recordings that start in mid-drive, with offsets: found, and taken out, for every tuner.

Whatever moved the vehicle before the first sample goes on as its free response, and
offsets of either channel end up as one constant.  Both are linear in unknowns that the
command does not explain, so one least-squares fit of the yaw rate on

    the command through many Laguerre functions,   their free responses,   a constant

tells them apart without knowing the vehicle.  A recording from rest is better off without
the last two, which cost information: they are left out where an F test finds nothing.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tuners.laguerre import Laguerre, lifted
from tuners.recording import Recording
from yawrate_env import validation

Array = NDArray[np.float64]

STARTS = ("auto", "rest", "unknown")

MODEL = Laguerre(order=20, pole=12.0)
"""Explains vehicles from 10 to 33 m/s to -45 dB or better, at 20 m/s to -80 dB."""

_SIGNIFICANT = 4.0  # standard deviations of the statistic under rest
_LARGEST_KEPT = 20_000  # samples: 3 MB
_NEGLIGIBLE = 3e-6  # of the yaw rate's energy: `MODEL` itself may leave out as much


@dataclass(frozen=True, slots=True, eq=False)
class BlackBox:
    """Laguerre models of B episodes, as the recordings alone determine them.

    Attributes
    ----------
    recording : Recording
        Without what the start and offsets contribute, where that was found.
    unknown : NDArray
        (B,) whether start and offsets were estimated.
    free : NDArray
        (B, N) what was taken out: free response and offset [rad/s].
    offset : NDArray
        (B,) constant part of the yaw rate [rad/s].
    coefficients : NDArray
        (B, n) on the functions of `MODEL`.
    information : NDArray
        (B, n, n) inverse of their covariance for noise of variance one.
    residual : NDArray
        (B,) sum of squares that is left [(rad/s)^2].
    """

    recording: Recording
    unknown: NDArray[np.bool_]
    free: Array
    offset: Array
    coefficients: Array
    information: Array
    residual: Array


def free_responses(N: int, Ts: float) -> tuple[Array, float]:
    """What the command does not explain, as orthonormal signals.

    Returns
    -------
    signals : (n + 1, N) float64
        They span what the states of `MODEL` decay by, and a constant, the last.
    constant : float
        Constant whose coefficient on the last signal is one.
    """
    return (_kept if N <= _LARGEST_KEPT else _free_responses)(N, Ts)


def _free_responses(N: int, Ts: float) -> tuple[Array, float]:
    impulse = np.zeros((1, N + 1))
    impulse[0, 0] = 1.0
    decays = MODEL.regressors(impulse, Ts)[0, :, 1:]
    Q, R = np.linalg.qr(np.concatenate([decays, np.ones((1, N))]).T)
    return np.ascontiguousarray(Q.T), float(1 / R[-1, -1])


_kept = lru_cache(maxsize=4)(_free_responses)


def black_box(recording: Recording, start: str) -> BlackBox:
    """Fit `MODEL` to every episode and take out what the start and offsets contribute.

    Parameters
    ----------
    start : {"auto", "rest", "unknown"}
        Whether episodes start from rest without offsets, or what the data say.
    """
    validation.one_of("start", start, STARTS)
    y, n = recording.y, MODEL.order
    if y.shape[1] < 10 * n:
        raise ValueError(
            f"{y.shape[1]} samples are too few, at least {10 * n} are needed. Record for longer."
        )
    Z, constant = free_responses(y.shape[1], recording.Ts)
    gram, right = MODEL.normal_equations(recording.u, y, recording.Ts, Z)
    G, P, b, d = gram[:, :n, :n], gram[:, :n, n:], right[:, :n], right[:, n:]
    energy = np.einsum("bn,bn->b", y, y)

    G = lifted(G)
    rest = _solve(G, b)
    residual_rest = energy - _inner(b, rest)
    information = lifted(G - P @ P.transpose(0, 2, 1))
    moving = _solve(information, b - (P @ d[..., None])[..., 0])
    z = d - (P.transpose(0, 2, 1) @ moving[..., None])[..., 0]
    residual_moving = energy - _inner(b, moving) - _inner(d, z)

    unknown = np.full(len(y), start == "unknown")
    if start == "auto":
        independent = (y.shape[1] - len(gram[0])) / recording.oversampled
        with np.errstate(divide="ignore", invalid="ignore"):  # a yaw rate of zeros
            statistic = (residual_rest / residual_moving - 1) * independent
        unknown = statistic > len(Z) + _SIGNIFICANT * np.sqrt(2 * len(Z))
        unknown &= residual_rest - residual_moving > _NEGLIGIBLE * energy
    free = np.where(unknown[:, None], z @ Z, 0.0)
    return BlackBox(
        replace(recording, y=y - free),
        unknown,
        free,
        np.where(unknown, z[:, -1] * constant, 0.0),
        np.where(unknown[:, None], moving, rest),
        np.where(unknown[:, None, None], information, G),
        np.where(unknown, residual_moving, residual_rest),
    )


def _solve(matrix: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])


def _inner(a: Array, b: Array) -> Array:
    return np.asarray((a * b).sum(axis=1))
