"""Tuners of ready process plants on recordings that SciPy simulated (`scripts/process_plants.py`).

results/process_plants.json   every plant that was run, and every fault
results/process_plants.md     the same as tables
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.markdown import table
from studies.process_recordings import FAULTS, Fault, recordings
from studies.readme import updated
from tuners import Tuner, train
from tuners.trust.bound import cramer_rao
from tuners.trust.checks import Assessment
from tuners.trust.findings import MISS
from tuners.tuner.hidden_faults import as_record, hidden_faults
from tuners.tuner.recording import Recording
from tuners.tuner.sampling import sampled
from yawrate_env.files import write_text
from yawrate_env.plant.episodes import BLOCK, parameters
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.streams import stream

Array = NDArray[np.float64]

HEADING = """\
# Process plants

Made by `scripts/process_plants.py`; edits are overwritten. SciPy simulated the recordings in steps
of a twentieth of a sample; errors are distances from what the design rule reaches that knows the
plant; a miss is more than twice a metric's `error`."""

CALIBRATION = 2000
"""Episodes that calibrate intervals, as of `yawrate train`."""

_OWN = 77  # tag of the plants' random numbers, which no training shares


def run(
    plant: Plant,
    name: str,
    results: Path,
    *,
    count: int,
    faulty: int,
    seed: int,
    progress: Any = None,
    readme: Path | None = None,
) -> str:
    """Train, record, tune, write; returns the plant's section of the page."""
    tuner = trained(plant, seed, progress)
    part = {
        "seed": seed,
        "answers": tuner.training.get("answers"),
        "right": right(tuner, count, seed),
        "hides": as_record(hidden_faults(tuner, seed)) if faulty else [],
        "faults": [faulted(tuner, fault, faulty, seed) for fault in FAULTS[1:] if faulty],
    }
    path = results / "process_plants.json"
    parts = json.loads(path.read_text()) if path.exists() else {}
    parts[name] = part
    results.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps(parts, indent=1) + "\n")
    write_text(results / "process_plants.md", page(parts))
    if readme is not None:
        write_text(readme, updated(readme.read_text(), "process_plants", overview(parts)))
    return section(name, part)


def trained(plant: Plant, seed: int, progress: Any = None) -> Tuner:
    """A tuner of the default recipe."""
    return train(plant, seed=seed, calibration=CALIBRATION, progress=progress)


def drawn(plant: Plant, count: int, seed: int) -> Array:
    """(count, p) plants of the prior that no training has seen."""
    return parameters(plant, stream((_OWN, seed), 0, count, len(plant.prior)))


def right(tuner: Tuner, count: int, seed: int) -> dict[str, Any]:
    """Accuracy, verdicts and intervals on `count` right recordings."""
    return accuracy(tuner, drawn(tuner.plant, count, seed), FAULTS[0], seed)


def accuracy(tuner: Tuner, theta: Array, fault: Fault, seed: int) -> dict[str, Any]:
    """Errors over the bound, verdicts and intervals on recordings of plants (B, p)."""
    plant, found = tuner.plant, answered(tuner, theta, fault, seed)
    error, verdicts = found["error"], found["verdicts"]
    bound = cramer_rao(plant, theta)
    rms = np.sqrt(np.mean(error**2, axis=0)) / np.sqrt(np.mean(bound**2, axis=0))
    names = plant.counted
    return {
        "recordings": len(theta),
        "over_bound": dict(zip(names, rms.tolist(), strict=True)),
        "bound": dict(zip(names, np.sqrt((bound**2).mean(axis=0)).tolist(), strict=True)),
        "usable": float((verdicts == 0).mean()),
        "with_care": float((verdicts == 1).mean()),
        "missed": float(_missed(plant, error).mean()),
        "exact_held": dict(zip(names, found["exact_held"].mean(axis=0).tolist(), strict=True)),
        "headline_held": dict(zip(names, found["held"].mean(axis=0).tolist(), strict=True)),
    }


def faulted(tuner: Tuner, fault: Fault, count: int, seed: int) -> dict[str, Any]:
    """Verdicts and misses on `count` recordings with a fault."""
    found = answered(tuner, drawn(tuner.plant, count, seed), fault, seed)
    missed, verdicts = _missed(tuner.plant, found["error"]), found["verdicts"]
    refused_by = [names for names, verdict in zip(found["refused_by"], verdicts, strict=True)
                  if verdict == 2]  # fmt: skip
    listed = sorted({name for names in refused_by for name in names})
    return {
        "fault": fault.name,
        "recordings": count,
        "missed": float(missed.mean()),
        "usable": float((verdicts == 0).mean()),
        "with_care": float((verdicts == 1).mean()),
        "usable_and_missed": float((missed & (verdicts == 0)).mean()),
        "with_care_and_missed": float((missed & (verdicts == 1)).mean()),
        "refused_by": {name: sum(name in names for names in refused_by) for name in listed},
    }


def answered(tuner: Tuner, theta: Array, fault: Fault, seed: int) -> dict[str, Any]:
    """What a tuner says of recordings of plants (B, p), as `Tuner.tune` would."""
    parts: list[dict[str, Any]] = []
    for first in range(0, len(theta), BLOCK):
        parts.append(_block(tuner, theta[first : first + BLOCK], fault, (seed, first)))
    return {
        name: sum((part[name] for part in parts), []) if name == "refused_by"
        else np.concatenate([part[name] for part in parts])
        for name in parts[0]
    }  # fmt: skip


def _block(tuner: Tuner, theta: Array, fault: Fault, seed: tuple[int, int]) -> dict[str, Any]:
    plant = tuner.plant
    u, y, Ts = recordings(plant, theta, fault, (FAULTS.index(fault), *seed))
    recording = Recording(u, y, Ts)
    gains, found = tuner.assess(recording)
    found = sampled(plant, recording, found)
    actual = plant.metric_values(theta, gains.values)
    aim = plant.metric_values(theta, plant.oracle(theta))
    with np.errstate(invalid="ignore"):
        within = np.abs(actual - found.metrics) <= np.array(tuner.calibration) * found.spread
        exact = np.array(tuner.exact_calibration) * found.exact_spread
        return {
            "error": actual - aim,
            "verdicts": found.verdicts,
            "held": within,
            "exact_held": np.abs(actual - found.exact_metrics) <= exact,
            "refused_by": _refused_by(found),
        }


def _refused_by(found: Assessment) -> list[list[str]]:
    """Checks that refuse each recording."""
    return [
        [name for name, each in found.findings.items() if not each.values[i] <= each.refusal]
        for i in range(len(found.metrics))
    ]


def _missed(plant: Plant, error: Array) -> NDArray[np.bool_]:
    most = MISS * plant.metric_setting("error")
    return np.asarray((~(np.abs(error) <= most)).any(axis=1))


def page(parts: Mapping[str, Mapping[str, Any]]) -> str:
    """Every plant's section, after a table of all."""
    sections = (section(name, parts[name]) for name in sorted(parts))
    return "\n\n".join([HEADING, summary(parts), *sections]) + "\n"


def summary(parts: Mapping[str, Mapping[str, Any]]) -> str:
    """Accuracy, verdicts and intervals of all plants."""
    heads = (
        "plant", "recordings", "error / bound", "usable", "with care",
        "90 % intervals hold, if exact", "headline",
    )  # fmt: skip
    rows = [(f"`{name}`", *_summary(part["right"])) for name, part in sorted(parts.items())]
    return table(heads, rows).strip()


def overview(parts: Mapping[str, Mapping[str, Any]]) -> str:
    """`summary`, and by fault the shares that miss and are called usable."""
    tried = {name: part["faults"] for name, part in sorted(parts.items()) if part["faults"]}
    if not tried:
        return summary(parts)
    heads = ("missed and usable (with care)", *(f"`{name}`" for name in tried))
    rows = [
        (fault.name, *(_called_usable(faults, fault.name) for faults in tried.values()))
        for fault in FAULTS[1:]
    ]
    return f"{summary(parts)}\n\n{table(heads, rows).strip()}"


def _called_usable(faults: Sequence[Mapping[str, Any]], name: str) -> str:
    """Shares of usable misses (with care) of a fault; nothing where it was not tried."""
    for row in faults:
        if row["fault"] == name:
            usable, care = row["usable_and_missed"], row["with_care_and_missed"]
            return f"{_percent(usable)} ({_percent(care)})"
    return ""


def section(name: str, part: Mapping[str, Any]) -> str:
    """One plant's faults."""
    heads = (
        "fault", "missed", "usable", "with care", "usable and missed", "with care and missed",
        "refused by",
    )  # fmt: skip
    shares = "missed", "usable", "with_care", "usable_and_missed", "with_care_and_missed"
    rows = [
        (row["fault"], *(_percent(row[of]) for of in shares), _counts(row["refused_by"]))
        for row in part["faults"]
    ]
    metrics = ", ".join(part["right"]["over_bound"])
    said = f"## {name}\n\n{part['right']['recordings']} right recordings"
    said += f", seed {part['seed']}; metrics: {metrics}."
    if not rows:
        return said
    count = part["faults"][0]["recordings"]
    said = f"{said} {count} with each fault:\n\n{table(heads, rows).strip()}"
    hidden = (f"{each['fault']} ({_percent(each['share'])})" for each in part.get("hides", ()))
    return f"{said}\n\nHidden, as `yawrate train` says, with the share: {', '.join(hidden)}."


def _summary(right: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        str(right["recordings"]),
        " / ".join(f"{ratio:.2f}" for ratio in right["over_bound"].values()),
        _percent(right["usable"]),
        _percent(right["with_care"]),
        " / ".join(map(_percent, right["exact_held"].values())),
        " / ".join(map(_percent, right["headline_held"].values())),
    )


def _counts(refused_by: Mapping[str, int]) -> str:
    """The three checks that refuse most."""
    most = sorted(refused_by.items(), key=lambda pair: -pair[1])[:3]
    return ", ".join(f"{name} {count}" for name, count in most)


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"
