"""From a plant to its results: train, compare, draw, write; what the examples run.

results/plants.json   figures of every plant that was run
results/plants.md     the same as tables
figures/NAME.png      one picture a plant
"""

import argparse
import json
import time
from pathlib import Path
from typing import Any

from studies.plants_pictures import overview
from tuners.cli.progress import Bars
from tuners.cli.report.palette import DPI
from tuners.tuner.plant_evaluation import (
    GRAY_BOX,
    NOMINAL,
    ORACLE,
    SEVERAL,
    TUNER,
    Comparison,
    compare,
)
from tuners.tuner.plant_tuner import PlantTuner
from tuners.tuner.training import train
from yawrate_env import validation
from yawrate_env.files import replacing, write_text
from yawrate_env.plant.episodes import episodes
from yawrate_env.plant.plant import Plant

TEST = 500


def main(plant: Plant) -> None:
    """Run a plant's file as a program."""
    name = plant.entry.partition(":")[0].rpartition(".")[2]
    parser = argparse.ArgumentParser(description=f"Train and compare tuners for {name}.")
    parser.add_argument("--plants", type=int, help="simulated for training, default 1000")
    parser.add_argument("--test", type=int, default=TEST, help="test episodes, default %(default)s")
    parser.add_argument("--seed", type=int, default=0, help="default 0")
    parser.add_argument("--out", type=Path, default=Path(), help="folder, default this one")
    args = parser.parse_args()
    try:
        with Bars() as bars:
            print(run(plant, name, args.out, args.plants, args.test, args.seed, bars))
    except ValueError as error:
        parser.exit(1, f"error: {error}\n")


def run(
    plant: Plant,
    name: str,
    out: Path,
    count: int | None,
    test: int,
    seed: int,
    progress: Any = None,
) -> str:
    """Train, compare and write; returns the plant's table."""
    validation.count("test", test, at_least=20, remedy="Compare on more episodes.")
    started = time.perf_counter()
    tuner = train(plant, count=count, seed=seed, progress=progress)
    trained = time.perf_counter()
    comparison = compare(tuner, test, seed)
    part = _part(tuner, comparison)
    part["seconds"] = {
        "training": trained - started,
        "comparison": time.perf_counter() - trained,
    }
    (block,) = episodes(plant, "test", seed, 0, 1)
    fit = tuner.tune(plant.u, block.y[0])
    _write(out, name, part)
    picture = overview(plant, block.y[0], fit.simulated, comparison)
    (out / "figures").mkdir(exist_ok=True)
    with replacing(out / "figures" / f"{name}.png") as file:
        picture.savefig(file, dpi=DPI, format="png")
    return table(name, part)


def _part(tuner: PlantTuner, comparison: Comparison) -> dict[str, Any]:
    """A plant's results as plain JSON values."""
    plant, bound = tuner.plant, comparison.bound
    rows = {
        name: {
            "rms": dict(zip(plant.metrics, comparison.rms(name).tolist(), strict=True)),
            "unstable": comparison.unstable(name),
        }
        for name in (TUNER, GRAY_BOX, SEVERAL, NOMINAL, ORACLE)
    }
    least = ((bound**2).mean(axis=0) ** 0.5).tolist()
    return {
        "training": tuner.training,
        "episodes": len(bound),
        "rows": rows,
        "bound": dict(zip(plant.metrics, least, strict=True)),
        "trusted": float(comparison.trusted.mean()),
        "gray box converged": float(comparison.converged.mean()),
        "coverage": dict(zip(plant.metrics, comparison.covered.mean(axis=0).tolist(), strict=True)),
    }


def table(name: str, part: dict[str, Any]) -> str:
    """One plant's results in Markdown."""
    figures = list(part["bound"])
    lines = [f"## {name}", ""]
    lines += [
        f"| tuner | {' | '.join(f'rms error of {f} | / bound' for f in figures)} | unstable |"
    ]
    lines += ["|---|" + "---:|" * (2 * len(figures) + 1)]
    for tuner, row in part["rows"].items():
        cells = [f"{row['rms'][f]:.3g} | {row['rms'][f] / part['bound'][f]:.2f}" for f in figures]
        lines.append(f"| {tuner} | {' | '.join(cells)} | {row['unstable']} |")
    cells = [f"{part['bound'][f]:.3g} | 1" for f in figures]
    lines.append(f"| Cramér–Rao bound | {' | '.join(cells)} | |")
    coverage = ", ".join(f"{f} {100 * c:.1f} %" for f, c in part["coverage"].items())
    training, seconds = part["training"], part["seconds"]
    lines += [
        "",
        f"{part['episodes']} test plants; trained on {training['vehicles']} others with "
        f"{training['noise_draws']} recordings of each, seed {training['seed']}. Errors are "
        "distances from what the design rule reaches that knows the plant.",
        f"Two-stage gains trusted: {100 * part['trusted']:.1f} %. Its 90 % intervals held: "
        f"{coverage}. Gray box converged: {100 * part['gray box converged']:.1f} %.",
        f"Training took {seconds['training']:.0f} s, comparison {seconds['comparison']:.0f} s.",
    ]
    return "\n".join(lines)


def _write(out: Path, name: str, part: dict[str, Any]) -> None:
    """Put a plant's part into the results of all."""
    folder = out / "results"
    folder.mkdir(exist_ok=True)
    path = folder / "plants.json"
    parts = json.loads(path.read_text()) if path.exists() else {}
    parts[name] = part
    write_text(path, json.dumps(parts, indent=1) + "\n")
    tables = "\n\n".join(table(n, parts[n]) for n in sorted(parts))
    heading = "# Plants of one's own\n\nMade by `examples/plants/*.py`; edits are overwritten."
    write_text(folder / "plants.md", f"{heading}\n\n{tables}\n")
