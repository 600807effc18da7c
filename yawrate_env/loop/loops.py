"""PI loops around B plants: the design rule, and the margins that given gains reach."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop import closed_loop, margins
from yawrate_env.loop.design import Design, design
from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.margins import Margins
from yawrate_env.loop.target import Target
from yawrate_env.loop.transfer_function import TransferFunction, open_loop


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """Margins of B loops, and whether each is stable (B,)."""

    margins: Margins
    stable: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Loops:
    """B plants as the controller sees them, and what their loops must reach."""

    plant: DiscretePlant
    transfer_function: TransferFunction
    target: Target

    @classmethod
    def of(cls, plant: DiscretePlant, target: Target) -> Self:
        """Loops of plants that are discretised at the controller's sampling time."""
        return cls(plant, TransferFunction.of(plant, target.delay_samples), target)

    def design(self) -> Design:
        """Gains of the design rule for each plant."""
        return design(self.transfer_function, self.target)

    def evaluate(self, kp: NDArray[np.float64], Ti: NDArray[np.float64]) -> Evaluation:
        """Evaluate gains (B,); a loop whose gains are not finite and positive is unstable."""
        valid = np.isfinite(kp) & np.isfinite(Ti) & (kp > 0) & (Ti > 0)
        kp, Ti = np.where(valid, kp, 1.0), np.where(valid, Ti, 1.0)
        found = margins.margins(open_loop(self.transfer_function, kp, Ti, self.target))
        stable = valid & closed_loop.stable(self.plant, kp, Ti, self.target)
        for values in (getattr(found, name) for name in Margins.__slots__):
            values[~valid] = np.nan
        return Evaluation(found, stable)
