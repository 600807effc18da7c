"""Twins: simulators of the yaw rate that a steering command causes.

A task holds its twin; recording, data sets, environments and tuners never ask which
one it is.  `LinearTwin` is the paper's; `yawrate_env.vehicle.nonlinear` has another.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop.dead_time import simulate_late
from yawrate_env.loop.output_lag import observer_form
from yawrate_env.loop.simulation import simulate_into
from yawrate_env.vehicle.discrete import plants
from yawrate_env.vehicle.single_track import Context, Vehicle

Simulator = Callable[[NDArray[np.float64], int, int], NDArray[np.float64]]
"""``simulator(out, i, j)`` writes the yaw rates of vehicles i to j, at most ``LANES`` of them,
and returns each one's sum of squares, summed alike whatever the batch."""


class Twin(Protocol):
    """A simulator of the vehicle; a frozen, hashable record of its own parameters."""

    linear: ClassVar[bool]
    """Whether responses add up."""

    def check(self, vehicle: Vehicle, others: Sequence[str]) -> None:
        """``ValueError`` where it cannot simulate the vehicle, with other parameters open."""

    def simulator(
        self, vehicle: Vehicle, context: Context, u: NDArray[np.float64], Ts: float
    ) -> Simulator:
        """Prepare the noise-free response of B vehicles from rest.

        Parameters
        ----------
        u : (1, N) or (B, N) float64
            Steering command, held between samples [rad].
        Ts : float
            Sampling time [s].
        """


@dataclass(frozen=True, slots=True)
class LinearTwin:
    """The single-track vehicle of eqs. (6) to (12), exact at the samples."""

    linear: ClassVar[bool] = True

    def check(self, vehicle: Vehicle, others: Sequence[str]) -> None:
        """Every vehicle can be simulated."""

    def simulator(
        self, vehicle: Vehicle, context: Context, u: NDArray[np.float64], Ts: float
    ) -> Simulator:
        """Prepare the recursion of the zero-order-hold plants."""
        discrete = plants(vehicle, context, Ts)
        form = observer_form(discrete)
        if discrete.delay is None:
            return lambda out, i, j: simulate_into(out, form, u, i, j)
        return lambda out, i, j: simulate_late(out, discrete, form, u, i, j)
