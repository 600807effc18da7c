"""The nonlinear twin: episodes on saturating tyres."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import LANES, kernel
from yawrate_env.vehicle.nonlinear.body import Body
from yawrate_env.vehicle.nonlinear.steering import Limits
from yawrate_env.vehicle.nonlinear.tyre import Tyre
from yawrate_env.vehicle.nonlinear.vehicle import advance
from yawrate_env.vehicle.nonlinear.workspace import COMMAND, YAW_RATE, block, packed
from yawrate_env.vehicle.single_track import Context, Vehicle
from yawrate_env.vehicle.twin import Simulator


@dataclass(frozen=True, slots=True)
class NonlinearTwin:
    """The vehicle with saturating tyres, steering limits, speed loss and load transfer.

    Attributes
    ----------
    tyre : Tyre
        Of both axles.
    body : Body
        Load transfer and drag.
    limits : Limits
        Of the steering actuator.
    """

    linear: ClassVar[bool] = False

    tyre: Tyre = field(default_factory=Tyre)
    body: Body = field(default_factory=Body)
    limits: Limits = field(default_factory=Limits)

    @classmethod
    def of(cls, **parts: Mapping[str, Any] | None) -> Self:
        """Build from plain mappings of parameters, as JSON has them."""
        kinds = {"tyre": Tyre, "body": Body, "limits": Limits}
        built: dict[str, Any] = {}
        for name, values in parts.items():
            kind = kinds[name]
            try:
                built[name] = kind(**(values or {}))
            except TypeError:
                names = ", ".join(kind.__slots__)  # type: ignore[attr-defined]
                raise ValueError(f"{name} = {values!r}: give any of {names}, as numbers.") from None
        return cls(**built)

    def check(self, vehicle: Vehicle, others: Sequence[str]) -> None:
        """``ValueError`` with a dead time or a sensor lag, which only the linear twin has."""
        for name in ("dead_time", "sensor_lag"):
            if name in others or getattr(vehicle, name) > 0:
                raise ValueError(
                    f"{name} must be 0 and not in the prior with the nonlinear twin, which "
                    "simulates none. Leave it out, or use the linear twin."
                )

    def simulator(
        self, vehicle: Vehicle, context: Context, u: NDArray[np.float64], Ts: float
    ) -> Simulator:
        """Prepare the integration of `vehicle.advance` from straight driving."""
        columns = packed(vehicle, self.tyre, self.body, self.limits, context, Ts)

        def simulate(out: NDArray[np.float64], i: int, j: int) -> NDArray[np.float64]:
            rows = np.minimum(np.arange(i, i + LANES), j - 1)
            own_input = rows if len(u) > 1 else np.zeros_like(rows)
            squares = np.zeros(LANES)
            _responses(block(columns, i, j), u, own_input, out, squares)
            return squares[: j - i]

        return simulate


@kernel
def _responses(
    work: NDArray[np.float64],
    u: NDArray[np.float64],
    own_input: NDArray[np.int64],
    y: NDArray[np.float64],
    squares: NDArray[np.float64],
) -> None:
    """Drive through the commands; the yaw rate is that before the sample's command acts."""
    for k in range(u.shape[1]):
        for lane in range(len(y)):
            y[lane, k] = work[YAW_RATE * LANES + lane]
        for lane in range(LANES):
            squares[lane] += work[YAW_RATE * LANES + lane] * work[YAW_RATE * LANES + lane]
            work[COMMAND * LANES + lane] = u[own_input[lane], k]
        advance(work)
