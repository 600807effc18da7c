"""Observations of an environment as the signals of recordings."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def signals(obs: NDArray[Any]) -> tuple[Array, Array]:
    """Inputs (1 or B, N) and outputs (B, N) of observations (B, rows, N).

    An input that all episodes share is given once.
    """
    u = obs[:, 0]
    u = u[:1] if (u == u[:1]).all() else u
    return u.astype(np.float64, order="C"), obs[:, 1].astype(np.float64, order="C")
