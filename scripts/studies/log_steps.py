"""Steps on the log: faults that the vehicle and its loop do not have."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from studies.drives import Drive, Step
from studies.faulty import Rng
from yawrate_env.vehicle.actuator import actuated


def command_shifted(side: int) -> Step:
    """The command is logged 5 to 60 samples late (1) or early (-1)."""

    def step(drive: Drive, rng: Rng) -> Drive:
        by = side * rng.integers(5, 60, (len(drive), 1))
        return replace(drive, u=_at(drive.u, np.arange(drive.shape[1]) - by))

    return step


def wheel_as_command(drive: Drive, rng: Rng) -> Drive:
    """The road wheel's angle is logged in place of the command."""
    vehicle, Ts = drive.task.vehicle, drive.task.experiment.Ts
    distinct, rows = np.unique(drive.u, axis=0, return_inverse=True)
    angles = np.stack([actuated(u, Ts, vehicle) for u in distinct])
    return replace(drive, u=angles[rows.ravel()])


def wrong_clock(drive: Drive, rng: Rng) -> Drive:
    """Time runs 3 to 10 % too fast or too slow."""
    B, N = drive.shape
    rate = 1 + rng.choice([-1, 1], (B, 1)) * rng.uniform(0.03, 0.1, (B, 1))
    at = np.clip(np.arange(N) / rate, 0, N - 1)
    y = np.stack([np.interp(t, np.arange(N), row) for t, row in zip(at, drive.y, strict=True)])
    return replace(drive, y=y, u=_at(drive.u, at.astype(np.int64)))


def held(*, both: bool) -> Step:
    """The yaw rate's samples, or those of both channels, are held for 20 to 60 ms."""

    def step(drive: Drive, rng: Rng) -> Drive:
        length = rng.integers(20, 60, (len(drive), 1))
        at = np.arange(drive.shape[1]) // length * length
        return replace(drive, y=_at(drive.y, at), u=_at(drive.u, at) if both else drive.u)

    return step


def jitter(drive: Drive, rng: Rng) -> Drive:
    """Blocks of 10 to 40 samples of the yaw rate come late, each by up to its length."""
    B, N = drive.shape
    length = rng.integers(10, 40, (B, 1))
    late = (rng.random((B, N)) * length).astype(np.int64)
    block = np.arange(N) // length
    return replace(drive, y=_at(drive.y, np.arange(N) - _at(late, block)))


def averaged(drive: Drive, rng: Rng) -> Drive:
    """The log has means of the last 20 to 100 samples."""
    return _filtered(drive, [(np.ones(n) / n, [1.0]) for n in rng.integers(20, 100, len(drive))])


def lag(drive: Drive, rng: Rng) -> Drive:
    """The log's yaw rate lags by 10 to 60 ms."""
    poles = np.exp(-drive.task.experiment.Ts / rng.uniform(0.01, 0.06, len(drive)))
    return _filtered(drive, [([1 - pole], [1.0, -pole]) for pole in poles])


def gain(drive: Drive, rng: Rng) -> Drive:
    """The log's yaw rate is 5 to 20 % too large or too small."""
    off = rng.choice([-1, 1], (len(drive), 1)) * rng.uniform(0.05, 0.2, (len(drive), 1))
    return replace(drive, y=drive.y * (1 + off))


def rows_lost(drive: Drive, rng: Rng) -> Drive:
    """50 to 400 rows are missing somewhere, and nothing shows it."""
    B, N = drive.shape
    first, missing = rng.integers(N // 5, 4 * N // 5, (B, 1)), rng.integers(50, 400, (B, 1))
    k = np.arange(N - 400)
    at = k + (k >= first) * missing
    return replace(drive, y=_at(drive.y, at), u=_at(drive.u, at))


def _at(values: NDArray[Any], index: NDArray[np.int64]) -> NDArray[Any]:
    """Samples (B, M) of rows (B, N); beyond the ends the first and last."""
    index = np.broadcast_to(index, (len(values), index.shape[-1]))
    return np.take_along_axis(values, np.clip(index, 0, values.shape[1] - 1), axis=1)


def _filtered(drive: Drive, filters: Sequence[tuple[Any, Any]]) -> Drive:
    rows = [lfilter(b, a, y) for (b, a), y in zip(filters, drive.y, strict=True)]
    return replace(drive, y=np.stack(rows))
