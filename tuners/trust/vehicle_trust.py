"""Trust in a vehicle's terms: its limits, its words, its answer.

What decides is `tuners.trust.checks`, the same for every plant.  A vehicle's recordings are
also asked whether their speed is one that the tuner was made for.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.trust.checks import GAUSSIAN, Assessment, Finding
from tuners.tuner.result import Interval, TuningResult, TwinFit
from yawrate_env import validation
from yawrate_env.loop.design import Design, Status
from yawrate_env.vehicle.plausible import LARGEST_ANGLE, LARGEST_YAW_RATE
from yawrate_env.vehicle.yaw_rate import SPEED_SLACK, context_of

Array = NDArray[np.float64]

_SPEED = (
    "The recording's speed is not one that the tuner was made for: train one for it, or use one "
    "for every speed."
)
_MISSED = "With the fitted vehicle these gains miss the target."

MESSAGES = {
    "implausible": f"Steering beyond {np.degrees(LARGEST_ANGLE):.0f} deg or a yaw rate beyond "
    f"{LARGEST_YAW_RATE:g} rad/s: check the units.",
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
                f"calibration {name}", getattr(self, name), at_least=0.0, remedy="Calibrate again."
            )

    @property
    def factors(self) -> Array:
        """Of phase margin and crossover, (2,)."""
        return np.array([self.phase_margin, self.crossover])


def of_vehicles(found: Assessment, v_x: Array, speeds: tuple[float, float]) -> Assessment:
    """Ask for the speed too, and say everything in a vehicle's words.

    Parameters
    ----------
    v_x : (B,) float64
        Speeds [m/s].
    speeds : tuple of float
        For which the tuner was made [m/s].
    """
    beyond = np.maximum(np.maximum(speeds[0] - v_x, v_x - speeds[1]), 0.0)
    return found.worded(MESSAGES).beside(speed=Finding(beyond, SPEED_SLACK, _SPEED))


def result(
    found: Assessment,
    design: Design,
    converged: bool,
    notes: tuple[str, ...],
    calibration: Calibration,
    safe: tuple[float, float],
) -> TuningResult:
    """Put the first episode's gains, margins and checks together."""
    checks = found.checks(0)
    half = calibration.factors * found.spread[0]
    phase_margin, crossover = (
        Interval(float(value), float(value - h), float(value + h))
        for value, h in zip(found.metrics[0], half, strict=True)
    )
    return TuningResult(
        kp=float(design.kp[0]),
        Ti=float(design.Ti[0]),
        status=Status(design.status[0]),
        converged=converged,
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
    fit, model = found.fit, found.model
    simulated, residual = fit.simulated[0], fit.residual[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        snr_db = float(10 * np.log10(simulated.var() / np.mean(residual**2)))
    return TwinFit(
        context=context_of(fit.theta[:1]),
        command=model.u[0],
        measured=simulated + residual,
        simulated=simulated,
        Ts=model.Ts,
        offset=float(model.offset[0]),
        initial=float(np.sqrt(np.mean((model.free[0] - model.offset[0]) ** 2))),
        from_rest=not model.unknown[0],
        snr_db=snr_db,
    )
