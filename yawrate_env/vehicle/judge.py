"""The one judge of gains: labels, rewards and every results table come from here."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop import closed_loop
from yawrate_env.loop import margins as loop
from yawrate_env.loop.design import Design, design
from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.margins import Margins, TransferFunction
from yawrate_env.loop.target import Target
from yawrate_env.plant.reward import reward
from yawrate_env.vehicle.episode import plants
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Task


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """What the loops of B vehicles do with given gains; arrays (B,)."""

    margins: Margins
    stable: NDArray[np.bool_]
    reward: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Judge:
    """The plants of B vehicles as the controller sees them."""

    plant: DiscretePlant
    transfer_function: TransferFunction
    target: Target

    @classmethod
    def of(cls, task: Task, context: Context) -> Self:
        """Discretise the vehicles at the controller's sampling time."""
        plant = plants(task.vehicle, context, task.target.Ts)
        return cls(plant, TransferFunction.of(plant, task.target.delay_samples), task.target)

    def oracle(self) -> Design:
        """Gains of the design rule that knows the vehicles."""
        return design(self.transfer_function, self.target)

    def __call__(self, kp: NDArray[np.float64], Ti: NDArray[np.float64]) -> Verdict:
        """Judge gains (B,); where they are not finite and positive the loop counts as unstable."""
        valid = np.isfinite(kp) & np.isfinite(Ti) & (kp > 0) & (Ti > 0)
        kp, Ti = np.where(valid, kp, 1.0), np.where(valid, Ti, 1.0)
        found = loop.margins(loop.open_loop(self.transfer_function, kp, Ti, self.target))
        stable = valid & closed_loop.stable(self.plant, kp, Ti, self.target)
        for values in (getattr(found, name) for name in Margins.__slots__):
            values[~valid] = np.nan
        graded = reward(found.phase_margin, found.crossover, stable, self.target)
        return Verdict(found, stable, graded)
