"""Observations of an environment as the signals of recordings."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import kernel

Array = NDArray[np.float64]


def signals(obs: NDArray[Any]) -> tuple[Array, Array]:
    """Inputs (1 or B, N) and outputs (B, N) of observations (B, rows, N).

    An input that all episodes share is given once.
    """
    u = obs[:, 0]
    u = u[:1] if (u == u[:1]).all() else u
    return u.astype(np.float64, order="C"), obs[:, 1].astype(np.float64, order="C")


@kernel
def complete(
    obs: NDArray[np.float32],
    u: NDArray[np.float64],
    low: np.float32,
    high: np.float32,
    within: NDArray[np.bool_],
) -> None:
    """Write inputs into row 0, and whether all of row 1 lies within bounds into `within`.

    Parameters
    ----------
    obs : (B, rows, N) float32
    u : (1, N) or (B, N) float64
    low, high : float32
        Bounds of the outputs, row 1.
    within : (B,) bool
        Written; false where an output is not a number too.
    """
    shared = len(u) == 1
    for b in range(len(obs)):
        command, inputs, outputs = u[0 if shared else b], obs[b, 0], obs[b, 1]
        outside = 0
        for k in range(obs.shape[2]):
            inputs[k] = command[k]
            outside += not (low <= outputs[k] <= high)
        within[b] = outside == 0
