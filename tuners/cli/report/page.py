"""From an answer about a vehicle to its page."""

import os
from typing import Any

import numpy as np

from tuners.cli.report import loops
from tuners.cli.report.figures import Traces
from tuners.cli.report.layout import Residuals, page, pictures, rows, shown_interval
from tuners.cli.report.numbers import minus
from tuners.cli.text import instead
from tuners.export.forms import Forms
from tuners.logs import Log
from tuners.tuner.result import TuningResult
from yawrate_env.files import write_text
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import IN_DEGREES, theta_of, yaw_rate

LONGEST_LAG = 0.5  # [s]
CHECKS = {
    "speed": ("Speed outside the tuner's", "m/s"),
    "implausible": ("Steering or yaw rate over what a car reaches", "1"),
    "noise": ("Residual over simulated yaw rate", "1"),
    "phase_margin_spread": ("Standard deviation of the phase margin", "°"),
    "crossover_spread": ("Standard deviation of the crossover", "Hz"),
    "misfit": ("Yaw rate that no vehicle explains", "1"),
    "response": ("Response off the fitted vehicle's", "1"),
    "outside": ("Vehicle outside the prior", "1"),
    "phase_margin_error": ("Phase margin off the target", "°"),
    "crossover_error": ("Crossover off the target", "Hz"),
    "colour": ("Residual's power at the crossover, over white", "1"),
    "unsolved": ("Design or numerics failed", "1"),
}
"""Names and units for people."""


def write_report(
    path: str | os.PathLike[str], result: TuningResult, log: Log, task: Task, tuner: str
) -> None:
    """Write the page, completely or not at all."""
    write_text(path, render(result, log, task, tuner))


def render(result: TuningResult, log: Log, task: Task, tuner: str) -> str:
    """The page as text."""
    return page(
        "vehicle.html",
        title=f"Yaw-rate controller from {log.source}",
        result=result,
        log=log,
        tuner=tuner,
        subject="vehicle",
        input="steering",
        output="yaw rate",
        instead=instead(result.fallback),
        numbers=[
            ("Gain kp", f"{result.kp:.4g}", "s", ""),
            ("Integral time Ti", f"{result.Ti:.4g}", "s", ""),
            shown_interval("Phase margin", result.phase_margin, "°"),
            shown_interval("Crossover", result.crossover, " Hz"),
        ],
        forms=Forms.of(result.kp, result.Ti, task.target),
        assumed=_assumed(result, log, task, tuner),
        notes=(*log.notes, *result.notes),
        checks=rows(result.checks, CHECKS),
        **_fit(result, log, task),
    )


def _fit(result: TuningResult, log: Log, task: Task) -> dict[str, Any]:
    fit = result.fit
    if fit is None:
        return {"fit": None}
    gains = np.array([result.kp, result.Ti])
    loop = yaw_rate(task).closed(theta_of(fit.context)[0], gains)
    residuals = Residuals.of(fit.residual, fit.command, fit.Ts, log.recorded_Ts, LONGEST_LAG)
    steer, measured, simulated = map(np.degrees, (fit.command, fit.measured, fit.simulated))
    traces = Traces(log.t0, fit.Ts, steer, measured, simulated, IN_DEGREES)
    drawn = loops.pictured(loop, IN_DEGREES[1])
    return {
        "fit": fit,
        "loop": loop,
        "margins": loops.margins(loop),
        "residuals": residuals,
        "svg": pictures(traces, residuals, "steering", **drawn),
    }


def _assumed(result: TuningResult, log: Log, task: Task, tuner: str) -> list[tuple[str, str]]:
    v, target, fit, v_x = task.vehicle, task.target, result.fit, log.speed
    low, high = task.prior.v_x
    speeds = f"{low:g} m/s" if low == high else f"{low:g} to {high:g} m/s"
    rows = [
        ("Tuner", f"{tuner}, made for {speeds}"),
        ("Vehicle", f"{v.M_0:g} kg without load, yaw inertia {v.J_z:g} kg m²"),
        ("Axles", f"{v.l_f:g} m and {v.l_r:g} m from the centre of gravity"),
        ("Cornering stiffness", f"{v.C_f / 1e3:g} and {v.C_r / 1e3:g} kN/rad on dry road"),
        ("Steering actuator", f"{v.omega_n / 2 / np.pi:.3g} Hz, damping ratio {v.xi:g}"),
        ("Target", f"phase margin {target.phase_margin:g}°, crossover {target.crossover:g} Hz"),
        ("Controller", f"every {1e3 * target.Ts:g} ms, delay {target.delay_samples} samples"),
        ("Recording", f"{log.excitation.duration:.4g} s, every {1e3 * log.recorded_Ts:g} ms"),
        ("Speed", f"{v_x.mean():.2f} m/s, from {v_x.min():.2f} to {v_x.max():.2f}"),
    ]  # fmt: skip
    if fit is not None:
        start = (
            "from rest, without offset"
            if fit.from_rest
            else f"in mid-drive; offset {minus(f'{np.degrees(fit.offset):.3f}')} deg/s, "
            f"initial movement {np.degrees(fit.initial):.3f} deg/s rms"
        )
        c = fit.context
        found = f"friction {c.mu_s[0]:.3g}, load {c.M_delta[0]:.0f} kg, SNR {fit.snr_db:.1f} dB"
        found = minus(found)
        rows += [("Start", start), ("Vehicle that fits", found)]
    return rows
