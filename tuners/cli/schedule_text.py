"""A schedule of gains as text, CSV, JSON and a plot."""

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from tuners.cli.answer import bare, log_of, plain, share_of, units_of
from tuners.cli.text import (
    RUNGS,
    VERDICTS,
    agreement,
    described,
    gain_units,
    metric_name,
    quantity,
    unit_of,
)
from tuners.export.gains import plant_settings
from tuners.logs import Log
from tuners.trust.intervals import Interval
from tuners.tuner.result import Result
from tuners.tuner.schedule import Schedule
from yawrate_env.files import replacing, write_text
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant


def plant_of(found: Schedule) -> Plant:
    """The plant that the gains are for."""
    return found.results[0].plant


def label_of(found: Schedule) -> str:
    """The parameter's label, with its unit."""
    return plant_of(found).label(found.parameter)


def as_text(found: Schedule, logs: Sequence[Log]) -> str:
    """Logs, then one line a value."""
    plant, (word, unit) = plant_of(found), split(label_of(found))
    shares = () if found.alone else found.results[0].logs
    lines = [
        f"{log.source}: {described(log, plant)}"
        + (f", {agreement(shares[k])}" if k < len(shares) else "")
        for k, log in enumerate(logs)
    ]
    units = gain_units(plant)
    gains = [f"{split(name)[0]} [{units[name]}]".replace(" []", "") for name in plant.gains]
    metrics = [f"{metric_name(n)} [{unit_of(n)}]".replace(" []", "") for n in plant.counted]
    heads = [f"{word} [{unit}]" if unit else word, *gains, *metrics, "verdict"]
    rows = [
        _cells(value, result) for value, result in zip(found.values, found.results, strict=True)
    ]
    widths = [max(len(row[k]) for row in [heads, *rows]) for k in range(len(heads))]
    table = ["  ".join(c.ljust(w) for c, w in zip(r, widths, strict=True)).rstrip()
             for r in [heads, *rows]]  # fmt: skip
    notes = ["", "Notes", *(f"  - {note}" for note in notes_of(found, logs))]
    return "\n".join([*lines, "", *table, *(notes if len(notes) > 2 else [])])


def _cells(value: float, result: Result) -> list[str]:
    gains = [_plus_minus(result.gain_intervals[name], v) for name, v in result.gains.items()]
    metrics = [_plus_minus(interval, interval.value) for interval in result.intervals.values()]
    return [f"{value:.4g}", *gains, *metrics, VERDICTS[result.verdict].lower()]


def _plus_minus(interval: Interval, value: float) -> str:
    if not np.isfinite(value):
        return "none"
    half = (interval.high - interval.low) / 2
    if not (np.isfinite(half) and half > 0):
        return f"{value:.4g}"
    digits = min(max(1 - int(np.floor(np.log10(half))), 0), 6)
    return f"{value:.{digits}f} ±{half:.{digits}f}"


def notes_of(found: Schedule, logs: Sequence[Log]) -> list[str]:
    """What a user should know, each once."""
    results = found.results
    every = [f"{log.source}: {note}" for log in logs for note in log.notes]
    every += [*found.notes, *_interpolated(found)]
    every += differences(results[0])
    for value, result in zip(found.values, results, strict=True):
        own = [reason for reason in result.reasons if reason not in differences(result)]
        every += [f"At {value:.4g}: {reason}" for reason in own]
    every += [note for result in results for note in result.notes]
    return list(dict.fromkeys(every))


def differences(result: Result) -> list[str]:
    """How logs disagree, which is the same at every value but for its numbers."""
    return [check.message for check in result.checks if check.name == "logs" and not check.passed]


def _interpolated(found: Schedule) -> list[str]:
    """What straight lines between the values cost."""
    if not all(np.isfinite(list(found.interpolation.values()))) or len(found.values) < 2:
        return []
    parts = [
        f"{quantity(value, unit_of(name), digits=2)} of {metric_name(name)}"
        for name, value in found.interpolation.items()
    ]
    return [f"Straight lines between these values cost at most {' and '.join(parts)}."]


def as_json(found: Schedule, logs: Sequence[Log], tuner: str) -> str:
    """Everything about a schedule as one JSON object; ``null`` where there is no number."""
    plant, (word, unit) = plant_of(found), split(label_of(found))
    shares = () if found.alone else found.results[0].logs
    content = {
        "trusted": found.trusted,
        "parameter": word,
        "unit": unit,
        "values": found.values.tolist(),
        "gains": bare({name: found.gains[:, k].tolist() for k, name in enumerate(plant.gains)}),
        "from_plant_fitted_to_all": not found.alone,
        "interpolation": bare(found.interpolation),
        "points": [
            _point(value, result) for value, result in zip(found.values, found.results, strict=True)
        ],
        "logs": [
            log_of(log, plant) | (share_of(shares[k], plant) if k < len(shares) else {})
            for k, log in enumerate(logs)
        ],
        "notes": notes_of(found, logs),
        "tuner": tuner,
        "units": units_of(plant),
        "plant": {"entry": plant.entry, **plant_settings(plant)},
    }
    return json.dumps(plain(content), indent=1, allow_nan=False)


def _point(value: float, result: Result) -> dict[str, Any]:
    def intervals(of: Any) -> dict[str, Any]:
        return bare({name: asdict(interval) for name, interval in of.items()})

    return {
        "at": float(value),
        "verdict": result.verdict.value,
        "answered_by": RUNGS[result.rung],
        "gains": intervals(result.gain_intervals),
        "gains_if_plant_exact": intervals(result.exact_gain_intervals),
        "metrics": intervals(result.intervals),
        "metrics_if_plant_exact": intervals(result.exact_intervals),
        "reasons": list(result.reasons),
    }


def write(path: Path, found: Schedule, logs: Sequence[Log], tuner: str) -> None:
    """Write a schedule as the file's ending asks."""
    if path.suffix == ".json":
        write_text(path, as_json(found, logs, tuner) + "\n")
    elif path.suffix == ".csv":
        write_text(path, as_csv(found))
    else:
        with replacing(path) as file:
            figure(found).savefig(file, format=path.suffix[1:])


def as_csv(found: Schedule) -> str:
    """One row a value: gains and metrics with the ends of their intervals."""
    text = io.StringIO(newline="")
    heads = [split(label_of(found))[0]]
    for name in (*found.results[0].gains, *found.results[0].intervals):
        heads += [split(name)[0], f"{split(name)[0]}_low", f"{split(name)[0]}_high"]
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*heads, "verdict"])
    for value, result in zip(found.values, found.results, strict=True):
        row = [f"{value:.9g}"]
        for interval in (*result.gain_intervals.values(), *result.intervals.values()):
            row += [f"{v:.9g}" for v in (interval.value, interval.low, interval.high)]
        writer.writerow([*row, result.verdict.value])
    return text.getvalue()


def figure(found: Schedule) -> Any:
    """The gains over the parameter with their intervals."""
    from matplotlib import style
    from matplotlib.figure import Figure

    from tuners.cli.report.figures import STYLE
    from yawrate_env.env import rendering

    plant, units = plant_of(found), gain_units(plant_of(found))
    page = {"figure.facecolor": "white", "figure.constrained_layout.use": True}
    with style.context(["default", STYLE, page]):
        picture = Figure(figsize=(6.4, 2.4 * len(plant.gains)))
        panels = picture.subplots(len(plant.gains), 1, sharex=True, squeeze=False)[:, 0]
        for axes, name in zip(panels, plant.gains, strict=True):
            ends = [result.gain_intervals[name] for result in found.results]
            low, value, high = (
                np.array([getattr(i, end) for i in ends]) for end in ("low", "value", "high")
            )
            axes.fill_between(found.values, low, high, color=rendering.LOOP, alpha=0.25, lw=0,
                              label="90 % interval")  # fmt: skip
            line = "o--" if found.alone else "o-"
            axes.plot(found.values, value, line, color=rendering.LOOP, ms=3.5, lw=1.4)
            bare_name = split(name)[0]
            axes.set_ylabel(f"{bare_name} [{units[name]}]" if units[name] else bare_name)
        panels[0].legend(loc="best")
        panels[-1].set_xlabel(label_of(found))
    return picture
