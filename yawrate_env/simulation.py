"""Noise-free response of a batch of plants: ``x[k+1] = A x[k] + B u[k], y[k] = C x[k]``.

The recursion runs ``LANES`` plants side by side.  The full matrices are kept: modal
coordinates need a third of the multiplications, but the eigendecomposition of one
plant costs as much as simulating ten thousand samples of it, and it breaks down where
poles meet (a critically damped actuator, say).  Profiling puts the recursion at about
half the cost of an episode; the noise is most of the rest.
"""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import LANES, kernel, over_blocks
from yawrate_env.discretisation import DiscretePlant


def simulate(
    plant: DiscretePlant, u: NDArray[np.float64], x0: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Simulate every plant.

    Parameters
    ----------
    plant : DiscretePlant
        B plants.
    u : (N,) or (B, N) float64
        One input for all, or one for each.
    x0 : (B, n) float64, optional
        Initial states; rest if not given.

    Returns
    -------
    y : (B, N) float64
        The output before the input of the same sample acts.
    """
    inputs = np.ascontiguousarray(np.atleast_2d(u), dtype=np.float64)
    if len(inputs) not in (1, len(plant)):  # the compiled loop does not check its indices
        raise ValueError(f"u has {len(inputs)} rows for {len(plant)} plants. Give 1 or as many.")
    y = np.empty((len(plant), inputs.shape[1]))
    states = np.zeros_like(plant.B) if x0 is None else np.ascontiguousarray(x0)
    over_blocks(lambda i, j: simulate_into(y[i:j], plant, inputs, states, i, j), len(plant), LANES)
    return y


def simulate_into(
    y: NDArray[np.float64],
    plant: DiscretePlant,
    u: NDArray[np.float64],
    x0: NDArray[np.float64],
    start: int,
    stop: int,
) -> None:
    """`simulate` plants ``start`` to ``stop``, at most ``LANES`` of them, into `y`."""
    rows = np.minimum(np.arange(start, start + LANES), stop - 1)
    own_input = rows if len(u) > 1 else np.zeros_like(rows)
    n = plant.B.shape[1]
    work = np.concatenate(
        [
            plant.A[rows].reshape(LANES, -1),
            plant.B[rows],
            np.broadcast_to(plant.C, (LANES, n)),
            x0[rows],
            np.zeros((LANES, n + 1)),
        ],
        axis=1,
    )
    _recursion(n)(np.ascontiguousarray(work.T).reshape(-1), u, own_input, y)


@cache
def _recursion(n: int) -> Any:
    """Compile for order `n`, known to the compiler so that it unrolls the sums.

    The workspace holds rows of one number a lane: A, B, C, the state now and next, and
    the input.  One flat array lets the compiler see that nothing overlaps.
    """
    INPUT, OUTPUT, STATE, NEXT, COMMAND = (
        row * LANES for row in (n * n, n * n + n, n * n + 2 * n, n * n + 3 * n, n * n + 4 * n)
    )

    @kernel
    def recursion(
        work: NDArray[np.float64],
        u: NDArray[np.float64],
        own_input: NDArray[np.int64],
        y: NDArray[np.float64],
    ) -> None:
        outputs = np.empty(LANES)
        for k in range(u.shape[1]):
            for lane in range(LANES):
                work[COMMAND + lane] = u[own_input[lane], k]
            for lane in range(LANES):
                total = 0.0
                for j in range(n):
                    total += work[OUTPUT + j * LANES + lane] * work[STATE + j * LANES + lane]
                outputs[lane] = total
            for i in range(n):
                for lane in range(LANES):
                    total = work[INPUT + i * LANES + lane] * work[COMMAND + lane]
                    for j in range(n):
                        a = work[(i * n + j) * LANES + lane]
                        total += a * work[STATE + j * LANES + lane]
                    work[NEXT + i * LANES + lane] = total
            for i in range(n * LANES):
                work[STATE + i] = work[NEXT + i]
            for lane in range(len(y)):
                y[lane, k] = outputs[lane]

    return recursion
