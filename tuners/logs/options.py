"""What the user says about a recording."""

from dataclasses import dataclass, field

from tuners.logs.columns import Choice


@dataclass(frozen=True, slots=True)
class Options:
    """What the user says about a recording; what is not said is found out.

    Attributes
    ----------
    choice : Choice
        Columns and units.
    Ts : float or None
        Sampling time [s], where there is no time column or it is not to be used.
    speed : float or None
        Constant speed [m/s], instead of a column.
    steer_ratio : float
        Hand-wheel angle over road-wheel angle.
    steer_sign, yaw_rate_sign : int
        -1 turns a signal round.
    start, stop : float or None
        Stretch to use, in the recording's own time [s].
    steer_is : {"command", "measured"}
        What the actuator was told, or the road-wheel angle that came of it.
    """

    choice: Choice = field(default_factory=Choice)
    Ts: float | None = None
    speed: float | None = None
    steer_ratio: float = 1.0
    steer_sign: int = 1
    yaw_rate_sign: int = 1
    start: float | None = None
    stop: float | None = None
    steer_is: str = "command"
