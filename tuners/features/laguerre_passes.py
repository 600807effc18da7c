"""Compiled passes of Laguerre functions over signals.

All filter by the recursion of `tuners.features.laguerre` with the discrete pole a,

    x_1+ = a x_1 + sqrt(1 - a^2) u,   x_{i+1}+ = a x_{i+1} + x_i - a x_i+.

Those with ``LANES`` episodes side by side are compiled for one number of functions: numbers that
the compiler knows let it vectorise.
"""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import LANES, kernel


@kernel
def filtered(u: NDArray[np.float64], a: float, out: NDArray[np.float64]) -> None:
    """Fill (order, N), of which the first column is zero."""
    gain = np.sqrt(1.0 - a * a)
    for k in range(1, len(u)):
        out[0, k] = a * out[0, k - 1] + gain * u[k - 1]
        for i in range(1, len(out)):
            out[i, k] = a * out[i, k - 1] + out[i - 1, k - 1] - a * out[i - 1, k]


@kernel
def outputs(
    u: NDArray[np.float64],
    weights: NDArray[np.float64],
    a: float,
    state: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """Fill (B, m, N), of which the first column is zero, from inputs (B, N), weights (B, m, n)."""
    gain = np.sqrt(1.0 - a * a)
    for b in range(len(weights)):
        for i in range(len(state)):
            state[i] = 0.0
        for k in range(1, u.shape[1]):
            held = state[0]
            state[0] = a * held + gain * u[b, k - 1]
            for i in range(1, len(state)):
                before = state[i]
                state[i] = a * before + held - a * state[i - 1]
                held = before
            for j in range(weights.shape[1]):
                total = 0.0
                for i in range(len(state)):
                    total += weights[b, j, i] * state[i]
                out[b, j, k] = total


@cache
def averages_of(order: int) -> Any:
    """Compile the filter of inputs (E, N) whose results (E, order, N // size) are averages."""
    BEFORE, HELD, SUMS = (row * LANES for row in (order, order + 1, order + 2))

    @kernel
    def run(
        u: NDArray[np.float64],
        episodes: NDArray[np.int64],
        a: float,
        size: int,
        work: NDArray[np.float64],
        out: NDArray[np.float64],
    ) -> None:
        gain = np.sqrt(1.0 - a * a)
        for m in range(out.shape[1]):
            work[SUMS : SUMS + order * LANES] = 0.0
            for k in range(m * size, (m + 1) * size):
                for i in range(order * LANES):
                    work[SUMS + i] += work[i]
                for lane in range(LANES):
                    work[BEFORE + lane] = u[episodes[lane], k]
                for lane in range(LANES):
                    work[HELD + lane] = work[lane]
                    work[lane] = a * work[lane] + gain * work[BEFORE + lane]
                for i in range(1, order):
                    for lane in range(LANES):
                        at = i * LANES + lane
                        before = work[at]
                        work[at] = a * before + work[HELD + lane] - a * work[at - LANES]
                        work[HELD + lane] = before
            for i in range(order):
                for lane in range(LANES):
                    out[i, m, lane] = work[SUMS + i * LANES + lane] / size

    return run


@cache
def sums_of(order: int, extras: int) -> Any:
    """Compile the pass over ``LANES`` episodes; numbers known to the compiler vectorise.

    The workspace, in rows of one number a lane: the filtered inputs, the measurement, the
    input now and before, a filter's previous output; then the sums of the filtered
    inputs times the first and times the measurement, and those of each further regressor
    times the filtered inputs and the measurement.
    """
    MEASURED, INPUT, BEFORE, HELD, FIRST, RIGHT, CROSS = (
        row * LANES
        for row in (order, order + 1, order + 2, order + 3, order + 4, 2 * order + 4, 3 * order + 4)
    )
    SIGNALS = (order + 1) * LANES

    @kernel
    def run(
        u: NDArray[np.float64],
        y: NDArray[np.float64],
        episodes: NDArray[np.int64],
        extra: NDArray[np.float64],
        a: float,
        work: NDArray[np.float64],
    ) -> None:
        gain = np.sqrt(1.0 - a * a)
        for k in range(u.shape[1]):
            for lane in range(LANES):
                work[BEFORE + lane] = work[INPUT + lane]
                work[INPUT + lane] = u[episodes[lane], k]
                work[MEASURED + lane] = y[episodes[lane], k]
            for lane in range(LANES):
                work[HELD + lane] = work[lane]
                work[lane] = a * work[lane] + gain * work[BEFORE + lane]
                work[FIRST + lane] += work[lane] * work[lane]
                work[RIGHT + lane] += work[lane] * work[MEASURED + lane]
            for i in range(1, order):
                for lane in range(LANES):
                    at = i * LANES + lane
                    before = work[at]
                    now = a * before + work[HELD + lane] - a * work[at - LANES]
                    work[HELD + lane] = before
                    work[at] = now
                    work[FIRST + at] += now * work[lane]
                    work[RIGHT + at] += now * work[MEASURED + lane]
            for j in range(extras):
                e = extra[j, k]
                for i in range(SIGNALS):
                    work[CROSS + j * SIGNALS + i] += e * work[i]

    return run
