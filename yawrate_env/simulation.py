"""Noise-free response of a batch of plants: ``x[k+1] = A x[k] + B u[k], y[k] = C x[k]``.

The recursion runs ``LANES`` plants side by side.  The full matrices are kept: modal
coordinates need a third of the multiplications, but the eigendecomposition of one
plant costs as much as simulating ten thousand samples of it, and it breaks down where
poles meet (a critically damped actuator, say).  Profiling puts the recursion at less
than half the cost of an episode, behind the noise.
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
    _recursion(plant.B.shape[1])(
        np.ascontiguousarray(np.moveaxis(plant.A[rows], 0, -1)),
        np.ascontiguousarray(plant.B[rows].T),
        plant.C,
        np.ascontiguousarray(x0[rows].T),
        u,
        own_input,
        y,
    )


@cache
def _recursion(n: int) -> Any:
    """Compile the recursion for order `n`, known to the compiler so that it unrolls the sums."""

    @kernel
    def recursion(
        A: NDArray[np.float64],
        B: NDArray[np.float64],
        C: NDArray[np.float64],
        x: NDArray[np.float64],
        u: NDArray[np.float64],
        own_input: NDArray[np.int64],
        y: NDArray[np.float64],
    ) -> None:
        following = np.empty((n, LANES))
        u_k, y_k = np.empty(LANES), np.empty(LANES)
        for k in range(u.shape[1]):
            for lane in range(LANES):
                u_k[lane] = u[own_input[lane], k]
            for lane in range(LANES):
                output = 0.0
                for j in range(n):
                    output += C[j] * x[j, lane]
                y_k[lane] = output
                for i in range(n):
                    total = B[i, lane] * u_k[lane]
                    for j in range(n):
                        total += A[i, j, lane] * x[j, lane]
                    following[i, lane] = total
            x[:] = following
            for lane in range(len(y)):
                y[lane, k] = y_k[lane]

    return recursion
