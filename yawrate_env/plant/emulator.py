"""Protocol of an emulator: what stands for the simulator of a plant that takes long."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Emulator(Protocol):
    """Outputs of plants without a call of their simulator, close to what it would give."""

    @property
    def batched(self) -> bool:
        """True: it takes many plants at once, whatever the simulator does."""

    def __call__(self, theta: Array, u: Array, rng: Any = None) -> Array:
        """Outputs (B, N) of plants (B, p) for an input (N,) or inputs (B, N) that it knows."""

    def knows(self, u: Array) -> bool:
        """Whether it answers inputs (1, N) or (B, N)."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays to save."""
