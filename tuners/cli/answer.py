"""A tuning result in words for people, and as one JSON object for machines."""

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from tuners.cli.text import between, instead
from tuners.export.forms import Forms
from tuners.logs import Log
from tuners.tuner.result import TuningResult
from yawrate_env.vehicle.task import Task


def as_json(result: TuningResult, log: Log, task: Task, tuner: str) -> dict[str, Any]:
    """Everything about an answer, in plain JSON values; ``null`` where there is no number."""
    fit = result.fit
    answer = {
        "kp": result.kp,
        "Ti": result.Ti,
        "trusted": result.trusted,
        "reasons": result.reasons,
        "notes": (*log.notes, *result.notes),
        "phase_margin": asdict(result.phase_margin),
        "crossover": asdict(result.crossover),
        "status": result.status.name.lower(),
        "converged": result.converged,
        "fallback": dict(zip(("kp", "Ti"), result.fallback, strict=True)),
        "checks": [asdict(check) | {"passed": check.passed} for check in result.checks],
        "forms": asdict(Forms.of(result.kp, result.Ti, task.target)),
        "target": asdict(task.target),
        "tuner": tuner,
        "log": {
            "file": log.source,
            "start": log.t0,
            "samples": len(log.steer),
            "Ts": log.Ts,
            "speed": float(log.speed.mean()),
            "excitation": asdict(log.excitation),
        },
        "fit": None
        if fit is None
        else {
            "mu_s": fit.context.mu_s[0],
            "M_delta": fit.context.M_delta[0],
            "offset": fit.offset,
            "initial": fit.initial,
            "from_rest": fit.from_rest,
            "snr_db": fit.snr_db,
        },
    }
    values: dict[str, Any] = plain(answer)
    return values


def as_text(result: TuningResult, log: Log, task: Task) -> str:
    """A few aligned lines."""
    forms = Forms.of(result.kp, result.Ti, task.target)
    gains = [("kp", f"{result.kp:.4g} s"), ("Ti", f"{result.Ti:.4g} s")]
    if result.trusted:
        gains += [
            ("phase margin", between(result.phase_margin, " deg")),
            ("crossover", between(result.crossover, " Hz")),
            ("every", f"{1e3 * forms.Ts:g} ms: {forms.equation}"),
        ]
    shown = [f"  {name:<14}{value}" for name, value in gains]
    lines = [described(log), ""]
    if result.trusted:
        lines += [*shown, "", "Trusted: every check passed."]
    else:
        lines += ["NOT TRUSTED", *(f"  - {reason}" for reason in result.reasons), "", *shown, ""]
        lines.append(instead(result.fallback))
    notes = (*log.notes, *result.notes)
    if notes:
        lines += ["", "Notes", *(f"  - {note}" for note in notes)]
    return "\n".join(lines)


def described(log: Log) -> str:
    """One line about a log."""
    e = log.excitation
    return (
        f"{log.source}: {log.t0:.2f} to {log.t0 + e.duration:.2f} s at {log.speed.mean():.1f} m/s, "
        f"steering ±{np.degrees(e.amplitude):.2g} deg"
    )


def plain(value: Any) -> Any:
    """Tuples, NumPy's numbers and those that are not finite, as JSON knows them."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
