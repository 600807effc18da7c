"""Body parameters of the nonlinear vehicle: lateral load transfer, drag and speed loss."""

from dataclasses import dataclass, fields

import numpy as np

from yawrate_env import validation

GRAVITY = 9.81


@dataclass(frozen=True, slots=True)
class Body:
    """Parameters of load transfer and drag.

    Attributes
    ----------
    height : float
        Centre of gravity above the roll axis and the road, effective for load transfer [m].
    track : float
        Between the wheels of an axle [m].
    front_share : float
        Of the load transfer, what the front axle takes.
    roll_lag : float
        Time constant from lateral acceleration to load transfer [s].
    drag : float
        Half of air density times drag area [kg/m].
    """

    height: float = 0.55
    track: float = 1.55
    front_share: float = 0.55
    roll_lag: float = 0.1
    drag: float = 0.4

    def __post_init__(self) -> None:
        for field in fields(self):
            validation.like(
                f"body {field.name}",
                getattr(self, field.name),
                field.default,
                zero=field.name not in ("track", "roll_lag"),
                at_most=1.0 if field.name == "front_share" else np.inf,
            )
