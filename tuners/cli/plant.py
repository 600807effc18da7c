"""What ``train`` and ``tune`` do for one's own plant instead of a vehicle."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from tuners.cli.answer import plain

if TYPE_CHECKING:
    from tuners.plants import Plant, PlantResult

VALIDATION = 300


def train(plant: "Plant", out: Path, episodes: int | None, seed: int) -> str:
    """Train, save, and say how accurate the tuner is."""
    from tuners.plants import train
    from tuners.plants.evaluation import TUNER, compare
    from tuners.progress import Bars

    with Bars() as bars:
        tuner = train(plant, count=episodes, seed=seed, progress=bars)
    tuner.save(out)
    found = compare(tuner, VALIDATION, seed)
    bound = np.sqrt(np.nanmean(found.bound**2, axis=0))
    words = [
        f"{name} {rms:.2g} rms (bound {least:.2g})"
        for name, rms, least in zip(plant.figures, found.rms(TUNER), bound, strict=True)
    ]
    return f"{', '.join(words)}; {found.unstable(TUNER)} of {VALIDATION} without stable loop"


def tune(tuner: str, log: Path, machine: bool) -> bool:
    """Print the gains for a log; returns whether they are trusted."""
    from tuners.plants import load
    from tuners.plants.log import read

    trained = load(tuner)
    result = trained.tune(*read(log, trained.plant))
    click.echo(json.dumps(_json(result, tuner), indent=1) if machine else _text(result))
    return result.trusted


def is_plants(tuner: str) -> bool:
    """Whether a name is that of a plant's tuner file."""
    from tuners.model_file import SUFFIX, read

    return tuner.endswith(SUFFIX) and Path(tuner).is_file() and read(tuner)[0]["kind"] == "plant"


def _json(result: "PlantResult", tuner: str) -> object:
    return plain(
        {
            "gains": result.gains,
            "trusted": result.trusted,
            "reasons": result.reasons,
            "notes": result.notes,
            "figures": {name: asdict(interval) for name, interval in result.figures.items()},
            "fallback": result.fallback,
            "parameters": result.parameters,
            "checks": [asdict(check) | {"passed": check.passed} for check in result.checks],
            "tuner": tuner,
        }
    )


def _text(result: "PlantResult") -> str:
    rows = [(name, f"{value:.4g}") for name, value in result.gains.items()]
    rows += [
        (name, f"{i.value:.4g}  ({i.low:.4g} to {i.high:.4g})")
        for name, i in result.figures.items()
    ]
    width = max(len(name) for name, _ in rows) + 2
    lines = [*(f"  {name:<{width}}{value}" for name, value in rows), ""]
    if result.trusted:
        lines.append("Trusted: every check passed.")
    else:
        safe = ", ".join(f"{name} {value:.4g}" for name, value in result.fallback.items())
        lines += ["NOT TRUSTED", *(f"  - {reason}" for reason in result.reasons)]
        lines.append(f"Best for every plant of the prior: {safe}.")
    return "\n".join([*lines, *(f"Note: {note}" for note in result.notes)])
