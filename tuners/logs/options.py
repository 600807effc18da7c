"""Options of reading a log: what the user says about the file."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Options:
    """What the user says about a log file; what is omitted is found out.

    A role is ``time``, ``input``, ``output`` or a measured parameter, by its name or its label,
    with or without the unit: ``v_x`` or ``speed``.

    Attributes
    ----------
    columns : dict
        Role to the name or the number (from 1) of its column; ``reference`` too, the reference of
        the loop in which it was recorded, in the output's unit.
    units : dict
        Role to the unit of its column or value; by default what the file says, or the plant's.
    values : dict
        Measured parameter to its value, where it is not a column.
    input_scale, output_scale : float
        Factors by which the signals are multiplied, once they are in the plant's units.
    Ts : float or None
        Sampling time [s], where there is no time column or it is not to be used.
    start, stop : float or None
        Stretch to use, in the recording's own time [s].
    input_is : {"command", "measured"}
        Whether the input was recorded before the plant's actuator or after it.
    drove : (float, float) or None
        Gains (kp, Ti) of the PI in whose loop the log was recorded, to rebuild its reference.
    between : {"held", "lines"} or None
        How the input runs between its samples; as in the plant's recordings if not given.
    dbc : Path or None
        File of the signals in a CAN trace.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    values: Mapping[str, float] = field(default_factory=dict)
    input_scale: float = 1.0
    output_scale: float = 1.0
    Ts: float | None = None
    start: float | None = None
    stop: float | None = None
    input_is: str = "command"
    drove: tuple[float, float] | None = None
    between: str | None = None
    dbc: Path | None = None
