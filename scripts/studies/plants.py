"""From a plant to its results: train, compare, draw, write (`scripts/compare_plant.py`).

results/plants.json   metrics of every plant that was run
results/plants.md     the same as tables
figures/NAME.png      one picture a plant
docs/plants.md        the plant's table, where the page has a place for it
"""

import json
import time
from pathlib import Path
from typing import Any

from studies.markdown import table
from studies.plants_pictures import overview
from studies.plots import save
from studies.readme import updated
from tuners import Plant, Tuner, train
from tuners.tuner.comparison import (
    GRAY_BOX,
    NOMINAL,
    ORACLE,
    SEVERAL,
    TUNER,
    Comparison,
    compare,
)
from yawrate_env import validation
from yawrate_env.files import write_text
from yawrate_env.plant.episodes import recorded

HEADING = "# Plants of one's own\n\nMade by `scripts/compare_plant.py`; edits are overwritten."


def run(
    plant: Plant,
    name: str,
    results: Path,
    figures: Path,
    *,
    count: int | None,
    test: int,
    seed: int,
    progress: Any = None,
    page: Path | None = None,
) -> str:
    """Train, compare and write; returns the plant's section of the page."""
    validation.count("test", test, at_least=20, remedy="Compare on more episodes.")
    if plant.channels is not None:
        raise ValueError("plant: this study draws one input and output. Use scripts/channels.py.")
    started = time.perf_counter()
    tuner = train(plant, episodes=count, seed=seed, progress=progress)
    trained = time.perf_counter()
    comparison = compare(tuner, test, seed)
    part = _part(tuner, comparison)
    part["seconds"] = {
        "training": trained - started,
        "comparison": time.perf_counter() - trained,
    }
    block = recorded(plant, "test", seed, 1)
    fit = tuner.tune(block.u[0], block.y[0], measured=_measured(plant, block.theta[0])).fit
    _write(results, name, part)
    save(overview(plant, block.y[0], fit.simulated, comparison), figures / f"{name}.png")
    if page is not None:
        write_text(page, updated(page.read_text(), name, described(part)))
    return section(name, part)


def _measured(plant: Plant, theta: Any) -> dict[str, float]:
    return {name: float(theta[i]) for name, i in
            zip(plant.measured, plant.indices(plant.measured), strict=True)}  # fmt: skip


def _part(tuner: Tuner, comparison: Comparison) -> dict[str, Any]:
    """A plant's results as plain JSON values."""
    metrics, bound = tuner.plant.counted, comparison.bound
    rows = {
        name: {
            "rms": dict(zip(metrics, comparison.rms(name).tolist(), strict=True)),
            "unstable": comparison.unstable(name),
        }
        for name in (TUNER, GRAY_BOX, SEVERAL, NOMINAL, ORACLE)
    }
    least = ((bound**2).mean(axis=0) ** 0.5).tolist()
    return {
        "training": tuner.training,
        "episodes": len(bound),
        "rows": rows,
        "bound": dict(zip(metrics, least, strict=True)),
        "trusted": float(comparison.trusted.mean()),
        "gray box converged": float(comparison.converged.mean()),
        "coverage": dict(zip(metrics, comparison.covered.mean(axis=0).tolist(), strict=True)),
    }


def page(parts: dict[str, dict[str, Any]]) -> str:
    """Every plant's section."""
    return "\n\n".join([HEADING, *(section(name, parts[name]) for name in sorted(parts))]) + "\n"


def section(name: str, part: dict[str, Any]) -> str:
    """One plant's results in Markdown."""
    return f"## {name}\n\n{described(part)}"


def described(part: dict[str, Any]) -> str:
    """A plant's table and what it rests on."""
    bound, training, seconds = part["bound"], part["training"], part["seconds"]
    rows = [
        (tuner, *_cells(row["rms"], bound, ".2f"), row["unstable"])
        for tuner, row in part["rows"].items()
    ]
    rows.append(("Cramér–Rao bound", *_cells(bound, bound, "g"), ""))
    heads = [head for metric in bound for head in (f"rms error of {metric}", "/ bound")]
    coverage = ", ".join(f"{metric} {100 * c:.1f} %" for metric, c in part["coverage"].items())
    return (
        f"{table(('tuner', *heads, 'unstable'), rows)}\n"
        f"{part['episodes']} test plants; trained on {training['episodes']} others with "
        f"{training['noise_draws']} recordings of each, seed {training['seed']}. Errors are "
        "distances from what the design rule reaches that knows the plant.\n"
        f"Two-stage gains trusted: {100 * part['trusted']:.1f} %. Its 90 % intervals held: "
        f"{coverage}. Gray box converged: {100 * part['gray box converged']:.1f} %.\n"
        f"Training took {seconds['training']:.0f} s, comparison {seconds['comparison']:.0f} s."
    )


def _cells(rms: dict[str, float], bound: dict[str, float], form: str) -> list[str]:
    return [text for m in bound for text in (f"{rms[m]:.3g}", f"{rms[m] / bound[m]:{form}}")]


def _write(results: Path, name: str, part: dict[str, Any]) -> None:
    """Put a plant's part into the results of all."""
    results.mkdir(parents=True, exist_ok=True)
    path = results / "plants.json"
    parts = json.loads(path.read_text()) if path.exists() else {}
    parts[name] = part
    write_text(path, json.dumps(parts, indent=1) + "\n")
    write_text(results / "plants.md", page(parts))
