"""Inner products of the signals of `yawrate_env.vehicle.drive_slopes`, and delays, compiled.

Signals are the prediction error, v of the command and of the predicted output, a constant, what a
sample of delay changes, and the slopes by the noise's three parameters.
"""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import LANES, kernel, over_blocks

Array = NDArray[np.float64]

_FURTHER = 5  # signals beside error and v: one, late, disturbance, time, colour
_EVERY = 4  # samples: slopes are smooth enough for their products to be taken at every fourth
_RUN = 12  # samples, of which errors are summed to see whether they are white
_TEMPORARY = 7


@kernel
def delayed(
    u: NDArray[np.float64],
    before: NDArray[np.float64],
    samples: NDArray[np.float64],
    late: NDArray[np.float64],
) -> None:
    """Signals some samples ago; `before` holds those that went before."""
    N, known = u.shape[1], before.shape[1]
    for b in range(len(u)):
        whole = int(samples[b])
        share = samples[b] - whole
        for k in range(N):
            at = k - whole
            new = u[b, at] if at >= 0 else before[b, known + at]
            old = u[b, at - 1] if at >= 1 else before[b, known + at - 1]
            late[b, k] = (1 - share) * new + share * old


def signal_products(
    n: int, form: Array, start: Array, u: Array, y: Array
) -> tuple[Array, Array, Array]:
    """Inner products (B, m, m) of a window's signals, and the last states (B, n)."""
    count, m = len(form), 1 + 2 * n + _FURTHER
    upper = np.triu_indices(m)
    gram, last, slow = np.empty((count, m, m)), np.empty((count, n)), np.empty(count)

    first = 1 + 14 * n

    def one_block(i: int, j: int) -> None:
        lanes = np.minimum(np.arange(i, i + LANES), j - 1)
        work = np.zeros((first + m + _TEMPORARY + len(upper[0]), LANES))
        work[: 1 + 8 * n], work[1 + 8 * n : 1 + 9 * n] = form[lanes].T, start[lanes].T
        _recursion(n)(work.reshape(-1), u, y, lanes)
        sums = work[first + m + _TEMPORARY :, : j - i].T
        slow[i:j] = work[first + m + _TEMPORARY - 1, : j - i]
        sums[:, m:] *= u.shape[1] / -(-u.shape[1] // _EVERY)
        last[i:j] = work[1 + 8 * n : 1 + 9 * n, : j - i].T
        gram[i:j, upper[0], upper[1]] = sums
        gram[i:j, upper[1], upper[0]] = sums

    over_blocks(one_block, count, LANES)
    return gram, last, slow / (u.shape[1] // _RUN * _RUN)


# Rows of the workspace, one number a lane: the form's coefficients, five states (of the predictor,
# v of u and of its output, two slopes by the noise), the signals, temporaries, and the sums.


@cache
def _recursion(n: int) -> Any:
    """Compile for order `n`, known to the compiler so that it unrolls the sums."""
    SIGNALS = 1 + 2 * n + _FURTHER
    ALPHA, BETA, KAPPA, D_SIZE, D_COLOUR, D_ALPHA, D_BETA, D_KAPPA = (
        (1 + i * n) * LANES for i in range(8)
    )
    STATE, U, Y, SIZE, TIME, COLOUR = ((1 + i * n) * LANES for i in range(8, 14))
    SIGNAL = (1 + 14 * n) * LANES
    ONE, LATE, BY_SIZE, BY_TIME, BY_COLOUR = (
        SIGNAL + (1 + 2 * n + i) * LANES for i in range(_FURTHER)
    )
    COMMAND, OUTPUT, ANSWER, PUSH, PULL, RUN, SLOW = (
        SIGNAL + (SIGNALS + i) * LANES for i in range(_TEMPORARY)
    )
    SUMS = SLOW + LANES
    STEP = n * LANES

    @kernel
    def recursion(
        work: NDArray[np.float64],
        u: NDArray[np.float64],
        y: NDArray[np.float64],
        own: NDArray[np.int64],
    ) -> None:
        for lane in range(LANES):
            work[ONE + lane] = 1.0
        for k in range(y.shape[1]):
            for lane in range(LANES):
                work[COMMAND + lane] = u[own[lane], k]
                work[SIGNAL + lane] = y[own[lane], k]
            for lane in range(LANES):
                output = work[STATE + lane]
                work[OUTPUT + lane] = output
                work[SIGNAL + lane] -= output
                work[BY_SIZE + lane], work[BY_TIME + lane] = work[SIZE + lane], work[TIME + lane]
                work[BY_COLOUR + lane] = work[COLOUR + lane]
            for i in range(2 * STEP):
                work[SIGNAL + LANES + i] = work[U + i]
            for lane in range(LANES):
                answer, push, pull = 0.0, 0.0, 0.0
                for i in range(n):
                    at = i * LANES + lane
                    back = work[ALPHA + at] + work[KAPPA + at]
                    answer += work[BETA + at] * work[U + at]
                    push += back * work[U + at]
                    pull += back * work[Y + at]
                work[LATE + lane] = work[ANSWER + lane] - answer
                work[ANSWER + lane], work[PUSH + lane], work[PULL + lane] = answer, push, pull
            for i in range(SIGNALS):
                for lane in range(LANES):
                    product = work[SIGNAL + lane] * work[SIGNAL + i * LANES + lane]
                    work[SUMS + i * LANES + lane] += product
            for lane in range(LANES):
                work[RUN + lane] += work[SIGNAL + lane]
            if k % _RUN == _RUN - 1:
                for lane in range(LANES):
                    work[SLOW + lane] += work[RUN + lane] * work[RUN + lane]
                    work[RUN + lane] = 0.0
            if k % _EVERY == 0:
                at = SUMS + SIGNALS * LANES
                for i in range(1, SIGNALS):
                    for j in range(i, SIGNALS):
                        for lane in range(LANES):
                            product = work[SIGNAL + i * LANES + lane]
                            product *= work[SIGNAL + j * LANES + lane]
                            work[at + lane] += product
                        at += LANES
            for lane in range(LANES):
                c, e, output = work[lane], work[SIGNAL + lane], work[OUTPUT + lane]
                command = work[COMMAND + lane]
                s1, s2, s3 = work[BY_SIZE + lane], work[BY_TIME + lane], work[BY_COLOUR + lane]
                for i in range(n):
                    at = i * LANES + lane
                    alpha, kappa = work[ALPHA + at], work[KAPPA + at]
                    back = alpha + kappa
                    x = c * work[STATE + at] - alpha * output + work[BETA + at] * command
                    t1 = c * work[SIZE + at] - back * s1 + work[D_SIZE + at] * e
                    t3 = c * work[COLOUR + at] - back * s3 + work[D_COLOUR + at] * e
                    t2 = c * work[TIME + at] - back * s2 + work[D_KAPPA + at] * e
                    t2 += work[D_BETA + at] * command - work[D_ALPHA + at] * output
                    if i + 1 < n:
                        x += work[STATE + at + LANES]
                        t1 += work[SIZE + at + LANES]
                        t2 += work[TIME + at + LANES]
                        t3 += work[COLOUR + at + LANES]
                    work[STATE + at], work[SIZE + at], work[TIME + at] = x + kappa * e, t1, t2
                    work[COLOUR + at] = t3
                for j in range(1, n):
                    at = (n - j) * LANES + lane
                    work[U + at] = c * work[U + at] + work[U + at - LANES]
                    work[Y + at] = c * work[Y + at] + work[Y + at - LANES]
                work[U + lane] = c * work[U + lane] + command - work[PUSH + lane]
                work[Y + lane] = c * work[Y + lane] + output - work[PULL + lane]

    return recursion
