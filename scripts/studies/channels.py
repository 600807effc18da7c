"""A tuner of a plant with several channels, and recordings with one of these larger.

results/channels.json   counts by plant
results/channels.md     the same as a table
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.markdown import table
from studies.readme import updated
from tuners import Tuner, train
from tuners.trust.bound import cramer_rao
from tuners.trust.findings import MISS
from tuners.tuner.recording import Recording
from yawrate_env.files import write_text
from yawrate_env.plant.episodes import recorded
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

HEADING = """\
# Plants with several inputs and outputs

Made by `scripts/channels.py`; edits are overwritten. Of every recording one output, or what comes
of one input, is multiplied by 1.5. A miss is more than twice a metric's `error`."""

_LARGER = 1.5


def run(
    plant: Plant,
    name: str,
    results: Path,
    *,
    count: int,
    seed: int,
    progress: Any = None,
    readme: Path | None = None,
) -> str:
    """Train, tune, write; returns the page."""
    tuner = train(plant, seed=seed, progress=progress)
    block = recorded(plant, "test", seed, count)
    rows = [{"channel": "none", **judged(tuner, block.theta, block.y)}]
    for channel, y in larger(plant, block.theta, block.y):
        rows.append({"channel": f"{channel} x {_LARGER:g}", **judged(tuner, block.theta, y)})
    path = results / "channels.json"
    parts = json.loads(path.read_text()) if path.exists() else {}
    parts[name] = {"recordings": count, "seed": seed, "answers": tuner.training["answers"],
                   "rows": rows}  # fmt: skip
    results.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps(parts, indent=1) + "\n")
    text = page(parts)
    write_text(results / "channels.md", text)
    if readme is not None:
        write_text(readme, updated(readme.read_text(), "channels", rows_of(parts[name])))
    return text


def larger(plant: Plant, theta: Array, y: Array) -> Iterator[tuple[str, Array]]:
    """Outputs (B, q, N) of recordings with one channel larger, and which."""
    clean = plant.respond(theta)
    for j, name in enumerate(plant.outputs_named):
        scaled = y.copy()
        scaled[:, j] *= _LARGER
        yield split(name)[0], scaled
    for i, name in enumerate(plant.inputs_named):
        u = plant.u.copy()
        u[i] *= _LARGER
        yield split(name)[0], y + plant.respond(theta, u) - clean


def judged(tuner: Tuner, theta: Array, y: Array) -> dict[str, Any]:
    """Counts of verdicts and misses, errors over the bound, and how often intervals hold."""
    plant, names = tuner.plant, tuner.plant.counted
    gains, found = tuner.assess(Recording(plant.u[None], y, plant.Ts))
    actual = plant.metric_values(theta, gains.values)
    with np.errstate(invalid="ignore"):
        error = actual - plant.metric_values(theta, plant.oracle(theta))
        within = np.abs(actual - found.metrics) <= np.array(tuner.calibration) * found.spread
    missed = (~(np.abs(error) <= MISS * plant.metric_setting("error"))).any(axis=1)
    bound = np.sqrt(np.mean(cramer_rao(plant, theta) ** 2, axis=0))
    ratio = np.sqrt(np.nanmean(error**2, axis=0)) / bound
    return {
        "over_bound": dict(zip(names, ratio.tolist(), strict=True)),
        "held": dict(zip(names, within.mean(axis=0).tolist(), strict=True)),
        "usable": int((found.verdicts == 0).sum()),
        "with_care": int((found.verdicts == 1).sum()),
        "missed": int(missed.sum()),
        "trusted_and_missed": int((missed & found.trusted).sum()),
    }


def page(parts: dict[str, Any]) -> str:
    """Every plant's table."""
    sections = [HEADING]
    for name, part in sorted(parts.items()):
        counts = f"{part['recordings']} recordings of each kind, seed {part['seed']}."
        sections.append(f"## {name}\n\n{counts}\n\n{rows_of(part)}")
    return "\n\n".join(sections) + "\n"


def rows_of(part: dict[str, Any]) -> str:
    """One plant's table."""
    heads = (
        "channel", "error / bound", "90 % intervals hold", "usable", "with care", "missed",
        "trusted and missed",
    )  # fmt: skip
    rows = [
        (
            row["channel"],
            " / ".join(f"{ratio:.2f}" for ratio in row["over_bound"].values()),
            " / ".join(f"{100 * share:.1f} %" for share in row["held"].values()),
            *(row[of] for of in ("usable", "with_care", "missed", "trusted_and_missed")),
        )
        for row in part["rows"]
    ]
    return table(heads, rows).strip()
