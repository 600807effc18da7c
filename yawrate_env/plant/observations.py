"""Rows of an environment's observations around the outputs: inputs before, and bounds."""

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import kernel


@kernel
def complete(
    obs: NDArray[np.float32],
    u: NDArray[np.float64],
    low: NDArray[np.float32],
    high: NDArray[np.float32],
    within: NDArray[np.bool_],
) -> None:
    """Write inputs into the first rows, and whether all outputs lie in bounds into `within`.

    Parameters
    ----------
    obs : (B, rows, N) float32
        m inputs, q outputs, and any further rows.
    u : (1, m, N) or (B, m, N) float64
    low, high : (q,) float32
        Bounds of the outputs.
    within : (B,) bool
        Written; false where an output is not a number too.
    """
    shared, m = len(u) == 1, u.shape[1]
    for b in range(len(obs)):
        outside = 0
        for j in range(m):
            command, inputs = u[0 if shared else b, j], obs[b, j]
            for k in range(obs.shape[2]):
                inputs[k] = command[k]
        for j in range(len(low)):
            outputs = obs[b, m + j]
            for k in range(obs.shape[2]):
                outside += not (low[j] <= outputs[k] <= high[j])
        within[b] = outside == 0
