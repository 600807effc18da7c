"""What ``train`` and ``tune`` do for one's own plant instead of a vehicle."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from tuners.cli.answer import plain
from tuners.cli.hints import Array, Trial, hints
from tuners.cli.text import best, between, every
from tuners.logs.plant_log import PlantLog, PlantOptions, read_log
from tuners.tuner.plant_result import PlantResult
from yawrate_env.plant.names import valued

if TYPE_CHECKING:
    from tuners.plants import PlantTuner

VALIDATION = 300

USUAL = 0.95
"""Share of right recordings that are trusted; with less there is a remedy to say."""

STEP, LATEST = 0.001, 0.03
"""How much earlier an output is tried, in lengths of the experiment."""


def accuracy(tuner: "PlantTuner", seed: int) -> str:
    """Root mean square errors on fresh plants, beside the bound."""
    from tuners.tuner.plant_evaluation import TUNER, compare

    found = compare(tuner, VALIDATION, seed)
    bound = np.sqrt(np.nanmean(found.bound**2, axis=0))
    words = [
        f"{name} {rms:.2g} rms (bound {least:.2g})"
        for name, rms, least in zip(tuner.plant.metrics, found.rms(TUNER), bound, strict=True)
    ]
    lost, trusted = found.unstable(TUNER), found.trusted.mean()
    said = f"{', '.join(words)}; {lost} of {VALIDATION} without stable loop; {trusted:.0%} trusted"
    return said if trusted > USUAL else f"{said}, more would be with larger figures"


def tune(
    tuner: str, log: Path, options: PlantOptions, start: str, machine: bool, report: Path | None
) -> bool:
    """Print the gains for a plant's log; returns whether they are trusted."""
    trained = loaded(tuner)
    recording = read_log(log, trained.plant, options)
    Ts, length = recording.Ts, len(trained.plant.u) * trained.plant.Ts

    def answer_to(u: Array, y: Array) -> PlantResult:
        return trained.tune(u, y, Ts, recording.measured, start)

    result = answer_to(recording.u, recording.y)
    found = hints(
        Trial(answer_to, recording.u, recording.y),
        result,
        step=round(STEP * length / Ts),
        latest=int(LATEST * length / Ts),
        sign="With the input's sign reversed a plant fits: try --input-scale "
        f"{-options.input_scale:g}.",
        late=lambda samples: (
            f"The output seems to be logged {samples * Ts:.3g} s late: earlier, a plant fits."
        ),
    )
    result = replace(result, notes=(*result.notes, *found))
    if machine:
        click.echo(json.dumps(as_json(result, recording, tuner), indent=1))
    else:
        click.echo(as_text(result, recording))
    if report is not None:
        from tuners.cli.report import write_plant_report

        write_plant_report(report, result, recording, trained, tuner)
    return result.trusted


def is_plants(tuner: str) -> bool:
    """Whether a name is that of a plant's tuner file."""
    from tuners.tuner.tuner_file import SUFFIX, read

    return tuner.endswith(SUFFIX) and Path(tuner).is_file() and read(tuner)[0]["kind"] == "plant"


def loaded(tuner: str) -> "PlantTuner":
    """A plant's tuner from its file."""
    from tuners.plants import load

    return load(tuner)


def as_json(result: PlantResult, log: PlantLog, tuner: str) -> dict[str, Any]:
    """Everything about an answer, in plain JSON values; ``null`` where there is no number."""
    fit, plant = result.fit, result.plant
    values: dict[str, Any] = plain(
        {
            "gains": result.gains,
            "trusted": result.trusted,
            "reasons": result.reasons,
            "notes": (*log.notes, *result.notes),
            "figures": {name: asdict(interval) for name, interval in result.metrics.items()},
            "fallback": result.fallback,
            "parameters": result.parameters,
            "checks": [asdict(check) | {"passed": check.passed} for check in result.checks],
            "tuner": tuner,
            "plant": {
                "entry": plant.entry,
                "signals": plant.signals,
                "Ts": plant.Ts,
                "target": plant.parametrisation.target and asdict(plant.parametrisation.target),
            },
            "log": {
                "file": log.source,
                "start": log.t0,
                "samples": len(log.u),
                "Ts": log.Ts,
                "measured": log.measured,
            },
            "fit": {
                "deviations": fit.deviations,
                "offset": fit.offset,
                "from_rest": fit.from_rest,
                "snr_db": fit.snr_db,
            },
        }
    )
    return values


def as_text(result: PlantResult, log: PlantLog) -> str:
    """A few aligned lines."""
    rows = [(name, f"{value:.4g}") for name, value in result.gains.items()]
    rows += [(name, between(interval, "")) for name, interval in result.metrics.items()]
    width = max(len(name) for name, _ in rows) + 2
    lines = [described(log), "", *(f"  {name:<{width}}{value}" for name, value in rows), ""]
    if result.trusted:
        lines.append("Trusted: every check passed.")
    else:
        lines += ["NOT TRUSTED", *(f"  - {_because(result, reason)}" for reason in result.reasons)]
        lines += ["", best(result.fallback)]
    notes = (*log.notes, *result.notes)
    if notes:
        lines += ["", "Notes", *(f"  - {note}" for note in notes)]
    return "\n".join(lines)


def _because(result: PlantResult, reason: str) -> str:
    """A reason, and by how much."""
    failed = [c for c in result.checks if c.message == reason and not c.passed]
    names = ((c.name.replace("_", " "), c.value, c.limit) for c in failed)
    numbers = "; ".join(f"{name} {value:.3g}, at most {limit:.3g}" for name, value, limit in names)
    return f"{reason} ({numbers})"


def described(log: PlantLog) -> str:
    """One line about a log."""
    beside = "".join(f", {valued(*measured)}" for measured in log.measured.items())
    end = log.t0 + log.duration
    return f"{log.source}: {log.t0:.2f} to {end:.2f} s, {every(log.Ts)}{beside}"
