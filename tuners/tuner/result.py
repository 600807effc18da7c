"""What `Tuner.tune` answers: gains, what the recording says of them, and whether to trust them."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop.design import Status
from yawrate_env.vehicle.single_track import Context

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Interval:
    """A prediction and the 90 % interval around it."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, eq=False)
class TwinFit:
    """The simulator's vehicle that explains a recording best, and what it leaves over.

    Attributes
    ----------
    context : Context
        That vehicle, a batch of one.
    command, measured, simulated : NDArray
        (N,) steering command [rad], measured and simulated yaw rate [rad/s]; the simulated
        one has the offset and the response to the initial state in it.
    Ts : float
        Sampling time of these [s].
    offset : float
        Constant part of the yaw rate that the command does not explain [rad/s].
    initial : float
        Root mean square of the response to the initial state over the first second [rad/s].
    from_rest : bool
        Whether offset and initial state were found negligible and left out.
    snr_db : float
        Mean square of the simulated yaw rate over that of the residual [dB].
    """

    context: Context
    command: Array
    measured: Array
    simulated: Array
    Ts: float
    offset: float
    initial: float
    from_rest: bool
    snr_db: float

    @property
    def residual(self) -> Array:
        """Measured minus simulated yaw rate (N,) [rad/s]."""
        return self.measured - self.simulated


@dataclass(frozen=True, slots=True)
class Check:
    """One of the questions that decide on trust.

    Attributes
    ----------
    name : str
        Short, as a table shows it.
    value, limit : float
        What was found, and the largest value that passes.
    message : str
        In words, what it means where it fails.
    """

    name: str
    value: float
    limit: float
    message: str

    @property
    def passed(self) -> bool:
        """Whether the value is within its limit; not-a-number never is."""
        return bool(self.value <= self.limit)


@dataclass(frozen=True, slots=True)
class TuningResult:
    """Gains for one recorded episode.

    Attributes
    ----------
    kp : float
        Proportional gain [s].
    Ti : float
        Integral time [s].
    status : Status
        Whether the design target was reached.
    converged : bool
        Whether the tuner's own numerics succeeded.
    notes : tuple of str
        What differs from the conditions that the tuner was made for, in words.
    phase_margin, crossover : Interval
        What the recording says that these gains give [deg], [Hz]; ``nan`` where it says
        nothing.
    trusted : bool
        Whether every check passed.
    reasons : tuple of str
        Why not, in words.
    fallback : tuple of float
        (kp, Ti) that are stable for every vehicle of the prior: what to use instead of
        gains that are not trusted; ``nan`` where none are.
    checks : tuple of Check
        What was looked at.
    fit : TwinFit or None
        The simulator beside the recording; None where it could not be fitted.
    """

    kp: float
    Ti: float
    status: Status
    converged: bool
    notes: tuple[str, ...]
    phase_margin: Interval
    crossover: Interval
    trusted: bool
    reasons: tuple[str, ...]
    fallback: tuple[float, float]
    checks: tuple[Check, ...] = field(repr=False)
    fit: TwinFit | None = field(repr=False, compare=False)
