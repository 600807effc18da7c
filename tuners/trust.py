"""Whether gains can be trusted, judged by the recording that they come from.

The simulator is fitted to the recording (`tuners.twin`), and so is a black box that knows
nothing of vehicles (`tuners.start`).  Gains are trusted where the two tell the same story:
what the simulator leaves over, the command does not explain either (its cross-correlation
with the command, in the metric of the black box's coefficients), both respond alike at
the crossover, the identified vehicle is one of the prior's, its loop meets the target, and
the recording holds enough information to say so.  Nothing depends on which excitation
was used or which tuner answered.

The intervals are the fitted vehicle's margins plus or minus a factor times their standard
deviation, the factor calibrated by split conformal prediction (Lei et al., 2018) with the
scaled error as score.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.plausible import LARGEST_ANGLE, LARGEST_SPEED, LARGEST_YAW_RATE
from tuners.recording import Recording
from tuners.result import Check, Interval, TuningResult, TwinFit
from tuners.start import MODEL, BlackBox
from tuners.twin import Twins, fit, moved
from yawrate_env import validation
from yawrate_env.batch import take
from yawrate_env.design import Design, Status
from yawrate_env.episode import plants
from yawrate_env.judge import Judge
from yawrate_env.loop import TransferFunction
from yawrate_env.task import Task
from yawrate_env.vehicle import Context

Array = NDArray[np.float64]

LEVEL = 0.9
GAUSSIAN = 1.6449
"""Half width of the interval of `LEVEL` in standard deviations, for a normal error."""

_STEP = 1e-4
_DOUBT = 3.0  # standard deviations that a finding must exceed to count


@dataclass(frozen=True, slots=True)
class Limits:
    """Largest values that are still trusted.

    Attributes
    ----------
    speed : float
        Distance of the recording's speed from those that the tuner was made for [m/s].
    implausible : float
        Largest command, yaw rate or speed over what a car can do.
    noise : float
        Residual over simulated yaw rate, root mean squares.
    phase_margin_spread, crossover_spread : float
        Standard deviation of the predicted margins [deg], [Hz].
    misfit : float
        Yaw rate that the command explains and the fitted vehicle does not, over the yaw
        rate, beyond what noise can do.
    response : float
        Relative difference of fitted vehicle and black box at the crossover, beyond what
        noise can do; 0.02 is about a degree.
    outside : float
        Distance of the fitted vehicle from the prior, in its ranges' widths.
    phase_margin_error, crossover_error : float
        Predicted margins' distance from the target [deg], [Hz].
    colour : float
        Power of the residual around the crossover over that of white noise.
    unsolved : float
        Whether the design or the numerics failed, as 1 or 0.
    """

    speed: float = 0.25
    implausible: float = 1.0
    noise: float = 0.3
    phase_margin_spread: float = 0.5
    crossover_spread: float = 0.025
    misfit: float = 0.01
    response: float = 0.02
    outside: float = 0.1
    phase_margin_error: float = 1.5
    crossover_error: float = 0.075
    colour: float = 20.0
    unsolved: float = 0.0


@dataclass(frozen=True, slots=True)
class Calibration:
    """Half widths of the intervals in predicted standard deviations, and what they rest on.

    Attributes
    ----------
    phase_margin, crossover : float
        Factors; those of a normal error if nothing was calibrated.
    episodes, seed : int
        Of the calibration set; 0 episodes if nothing was calibrated.
    """

    phase_margin: float = GAUSSIAN
    crossover: float = GAUSSIAN
    episodes: int = 0
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("phase_margin", "crossover"):
            validation.number(
                f"calibration {name}", getattr(self, name), above=0.0, remedy="Calibrate again."
            )


@dataclass(frozen=True, slots=True, eq=False)
class Assessment:
    """What B recordings say of gains.

    Attributes
    ----------
    model : BlackBox
        Fitted without knowledge of vehicles.
    twins : Twins
        Fitted simulators.
    margins, spread : NDArray
        (B, 2) phase margin [deg] and crossover [Hz] of the loop with the fitted vehicle,
        and their standard deviations.
    findings : dict
        Name of a check to values (B,).
    converged : NDArray
        (B,) whether the tuner's own numerics succeeded.
    """

    model: BlackBox
    twins: Twins
    margins: Array
    spread: Array
    findings: dict[str, Array]
    converged: NDArray[np.bool_]

    def trusted(self, limits: Limits) -> NDArray[np.bool_]:
        """Where every finding is within its limit, (B,)."""
        within = [values <= getattr(limits, name) for name, values in self.findings.items()]
        return np.asarray(np.all(within, axis=0))

    def checks(self, index: int, limits: Limits) -> tuple[Check, ...]:
        """The checks of one recording, in words."""
        return tuple(
            Check(name, float(values[index]), getattr(limits, name), MESSAGES[name])
            for name, values in self.findings.items()
        )


_INFORMATION = (
    "The recording holds too little information: excite more strongly, more quickly, or for longer."
)
_MISSED = "With the fitted vehicle these gains miss the target."

MESSAGES = {
    "speed": "The recording's speed is not one that the tuner was made for: train one for it, or "
    "use one for every speed.",
    "implausible": f"Steering beyond {np.degrees(LARGEST_ANGLE):.0f} deg, a yaw rate beyond "
    f"{LARGEST_YAW_RATE:g} rad/s or a speed beyond {LARGEST_SPEED:g} m/s: check the units.",
    "phase_margin_spread": _INFORMATION,
    "crossover_spread": _INFORMATION,
    "misfit": "No vehicle that the simulator knows answers this command so: check units, "
    "signs, sampling time, delays between the channels, speed and the vehicle's data.",
    "response": "At the crossover the recording responds otherwise than the fitted vehicle: "
    "check speed, sampling time and the vehicle's data.",
    "noise": "The yaw rate hardly follows the command: too little steering, a dead or noisy "
    "sensor, or not the one of this vehicle.",
    "colour": "Something other than the command moves the yaw rate around the crossover: a "
    "disturbance, a drift or a sensor fault.",
    "outside": "The fitted vehicle lies outside the range that the tuner was made for.",
    "phase_margin_error": _MISSED,
    "crossover_error": _MISSED,
    "unsolved": "The target cannot be reached, or the numerics did not converge.",
}


def assess(
    task: Task,
    nominal: Context,
    recording: Recording,
    model: BlackBox,
    design: Design,
    converged: NDArray[np.bool_],
    v_x: Array,
    speeds: tuple[float, float],
) -> Assessment:
    """Ask the recordings about gains.

    Parameters
    ----------
    nominal : Context
        One vehicle, from which the simulator's fit starts.
    recording : Recording
        As recorded.
    model : BlackBox
        Fitted to it.
    design : Design
        Gains for each episode, and whether the design succeeded.
    converged : (B,) bool
        Whether the tuner did.
    v_x : (B,) float64
        Speeds [m/s].
    speeds : tuple of float
        For which the tuner was made [m/s].
    """
    twins = fit(task, nominal, model, recording.y, v_x)
    with np.errstate(all="ignore"):
        margins, spread = _margins(task, twins, design)
        target = np.array([task.target.phase_margin, task.target.crossover])
        error = np.abs(margins - target)
        findings = {
            "speed": np.maximum(np.maximum(speeds[0] - v_x, v_x - speeds[1]), 0.0),
            "implausible": _implausible(recording, v_x),
            "phase_margin_spread": spread[:, 0],
            "crossover_spread": spread[:, 1],
            "misfit": _misfit(model, twins),
            "response": _response(task, model, twins),
            "noise": _ratio(twins.residual, twins.simulated),
            "colour": twins.noise / (twins.residual**2).mean(axis=1) / recording.oversampled,
            "outside": _outside(task, twins),
            "phase_margin_error": error[:, 0],
            "crossover_error": error[:, 1],
            "unsolved": 1.0 - (converged & twins.converged & (design.status == Status.OK)),
        }
    return Assessment(model, twins, margins, spread, findings, converged)


def _margins(task: Task, twins: Twins, design: Design) -> tuple[Array, Array]:
    """Margins of the fitted vehicles' loops and their standard deviations, (B, 2) each."""

    def of(context: Context) -> Array:
        verdict = Judge.of(task, context)(design.kp, design.Ti)
        values = np.stack([verdict.margins.phase_margin, verdict.margins.crossover], axis=1)
        return np.where(verdict.stable[:, None], values, np.nan)

    count = len(twins.noise)
    columns = []
    for row in np.eye(2):
        sides = [
            of(moved(task.vehicle, twins.context, np.tile(sign * _STEP * row, (count, 1))))
            for sign in (1, -1)
        ]
        columns.append((sides[0] - sides[1]) / (2 * _STEP))
    J = np.stack(columns, axis=2)
    variance = np.einsum("bij,bjk,bik->bi", J, twins.covariance, J)
    return of(twins.context), np.sqrt(variance)


def _implausible(recording: Recording, v_x: Array) -> Array:
    """Largest command, yaw rate or speed over what a car can do."""
    angle, turn = (np.abs(x).max(axis=1) for x in (recording.u, recording.y))
    ratios = (angle / LARGEST_ANGLE, turn / LARGEST_YAW_RATE, v_x / LARGEST_SPEED)
    return np.asarray(np.max(np.broadcast_arrays(*ratios), axis=0))


def _ratio(residual: Array, simulated: Array) -> Array:
    return np.asarray(np.sqrt((residual**2).mean(axis=1) / simulated.var(axis=1)))


def _misfit(model: BlackBox, twins: Twins) -> Array:
    """What the black box explains beyond the fitted vehicle, relative, less what noise can do."""
    freedom = MODEL.order - 2
    excess = (twins.residual**2).sum(axis=1) - model.residual
    chance = twins.noise * (freedom + _DOUBT * np.sqrt(2 * freedom))
    return np.asarray(np.sqrt(np.maximum(excess - chance, 0) / (twins.simulated**2).sum(axis=1)))


def _response(task: Task, model: BlackBox, twins: Twins) -> Array:
    """Relative difference of black box and fitted vehicle, less three standard deviations."""
    Ts, omega = model.recording.Ts, np.array([task.target.omega_c])
    functions = MODEL.frequency_response(omega, Ts)[:, 0]
    own = model.coefficients @ functions
    fitted = TransferFunction.of(plants(task.vehicle, twins.context, Ts))(omega)[:, 0]
    scaled = np.linalg.solve(model.information, functions[:, None])[..., 0]
    spread = np.sqrt(twins.noise * (scaled @ functions.conj()).real) / np.abs(fitted)
    return np.asarray(np.maximum(np.abs(own / fitted - 1) - _DOUBT * spread, 0))


def _outside(task: Task, twins: Twins) -> Array:
    """Distance from the prior in widths of its ranges, less three standard deviations."""
    prior, context = task.prior, twins.context
    mass = task.vehicle.M_0 + context.M_delta
    doubt = _DOUBT * np.sqrt(twins.covariance.diagonal(axis1=1, axis2=2))
    worst = np.zeros(len(mass))
    for name, slack in (("mu_s", doubt[:, 0] * context.mu_s), ("M_delta", doubt[:, 1] * mass)):
        low, high = getattr(prior, name)
        value = getattr(context, name)
        beyond = np.maximum(np.maximum(low - value, value - high) - slack, 0)
        worst = np.maximum(worst, beyond / max(high - low, 1e-9))
    return worst


def result(
    found: Assessment,
    design: Design,
    notes: tuple[str, ...],
    calibration: Calibration,
    safe: tuple[float, float],
) -> TuningResult:
    """Put the first episode's gains, margins and checks together."""
    checks = found.checks(0, Limits())
    factors = (calibration.phase_margin, calibration.crossover)
    phase_margin, crossover = (
        Interval(float(value), float(value - factor * spread), float(value + factor * spread))
        for value, spread, factor in zip(found.margins[0], found.spread[0], factors, strict=True)
    )
    return TuningResult(
        kp=float(design.kp[0]),
        Ti=float(design.Ti[0]),
        status=Status(design.status[0]),
        converged=bool(found.converged[0]),
        notes=notes,
        phase_margin=phase_margin,
        crossover=crossover,
        trusted=all(check.passed for check in checks),
        reasons=tuple(dict.fromkeys(check.message for check in checks if not check.passed)),
        fallback=safe,
        checks=checks,
        fit=_twin_fit(found),
    )


def _twin_fit(found: Assessment) -> TwinFit:
    twins, recording = found.twins, found.model.recording
    simulated, residual = twins.simulated[0], twins.residual[0]
    free = found.model.free[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        snr_db = float(10 * np.log10(simulated.var() / np.mean(residual**2)))
    return TwinFit(
        context=take(twins.context, slice(0, 1)),
        command=recording.u[0],
        measured=simulated + residual,
        simulated=simulated,
        Ts=recording.Ts,
        offset=float(found.model.offset[0]),
        initial=float(np.sqrt(np.mean((free - found.model.offset[0]) ** 2))),
        from_rest=not found.model.unknown[0],
        snr_db=snr_db,
    )


def calibrated(
    predicted: Array, spread: Array, actual: Array, seed: int, level: float = LEVEL
) -> Calibration:
    """Calibration from as many episodes as there are rows, (E, 2) each."""
    factors = conformal(predicted, spread, actual, level)
    return Calibration(float(factors[0]), float(factors[1]), len(actual), seed)


def conformal(predicted: Array, spread: Array, actual: Array, level: float = LEVEL) -> Array:
    """Split conformal factors (f,) from calibration episodes, (E, f) each.

    The factor is the ceil((E + 1) level)-th smallest scaled error, which makes intervals
    hold with probability `level` or more whatever the errors' distribution.
    """
    scores = np.sort(np.abs(actual - predicted) / spread, axis=0)
    return np.asarray(scores[int(np.ceil((len(scores) + 1) * level)) - 1])
