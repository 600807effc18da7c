"""A tuner in every corner of its prior, and in the middle, on recordings that SciPy simulated.

results/corners.json   every plant that was run
results/corners.md     the same as a table
"""

import json
from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.markdown import table
from studies.process_plants import accuracy
from studies.process_recordings import FAULTS
from studies.readme import updated
from tuners import Tuner
from tuners.cli.train import recipe_table
from yawrate_env.files import write_text
from yawrate_env.plant.episodes import parameters
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.streams import stream, uniform

Array = NDArray[np.float64]

HEADING = """\
# Corners of priors

Made by `scripts/process_plants.py --corners`; edits are overwritten. A corner is the outermost
tenth of every unknown parameter's prior, the middle its inner half. SciPy simulated the recordings
in steps of a twentieth of a sample; errors are root mean squares over the Cramér–Rao bound's."""

_SHARES = {"low": (0.0, 0.1), "high": (0.9, 1.0)}
_MIDDLE = 0.25, 0.75
_OWN = 78  # tag of the random numbers, which no training shares


def parts(plant: Plant) -> Iterator[tuple[str, dict[int, tuple[float, float]]]]:
    """Names of the corners and the middle, and shares of the prior that they are, by parameter."""
    names = [split(plant.label(name))[0] for name in plant.prior]
    unknown = plant.unknown.tolist()
    for ends in product(_SHARES, repeat=len(unknown)):
        name = ", ".join(f"{names[i]} {end}" for i, end in zip(unknown, ends, strict=True))
        yield name, {i: _SHARES[end] for i, end in zip(unknown, ends, strict=True)}
    yield "middle", dict.fromkeys(unknown, _MIDDLE)


def drawn(plant: Plant, shares: Mapping[int, tuple[float, float]], count: int, seed: int) -> Array:
    """(count, p) plants from these shares of the prior, in its own distribution."""
    unit = uniform(stream((_OWN, seed), 0, count, len(plant.prior)))
    for i, (low, high) in shares.items():
        unit[:, i] = low + (high - low) * unit[:, i]
    integers = (unit * 2.0**53).astype(np.uint64) << np.uint64(11)  # what `uniform` turns back
    return parameters(plant, integers)


def measured(tuner: Tuner, count: int, seed: int) -> list[dict[str, Any]]:
    """Accuracy and verdicts of `count` recordings in each corner and in the middle."""
    return [
        {"part": name} | accuracy(tuner, drawn(tuner.plant, shares, count, seed), FAULTS[0], seed)
        for name, shares in parts(tuner.plant)
    ]


def write(
    tuner: Tuner, name: str, results: Path, count: int, seed: int, readme: Path | None = None
) -> str:
    """Measure and write; returns the plant's table."""
    path = results / "corners.json"
    found = json.loads(path.read_text()) if path.exists() else {}
    found[name] = {
        "seed": seed,
        "answers": tuner.training.get("answers"),
        "recipes": recipe_table(tuner),
        "parts": measured(tuner, count, seed),
    }
    write_text(path, json.dumps(found, indent=1) + "\n")
    write_text(results / "corners.md", page(found))
    if readme is not None:
        write_text(readme, updated(readme.read_text(), "corners", section(found[name])))
    return section(found[name])


def page(found: Mapping[str, Mapping[str, Any]]) -> str:
    """Every plant's section."""
    sections = (f"## {name}\n\n{section(part)}" for name, part in sorted(found.items()))
    return "\n\n".join([HEADING, *sections]) + "\n"


def section(found: Mapping[str, Any]) -> str:
    """A plant's table, and whose gains these are."""
    rows = found["parts"]
    metrics = ", ".join(rows[0]["over_bound"])
    heads = "part of the prior", "error / bound", "bound", "usable", "with care", "90 % intervals"
    lines = [
        (
            row["part"],
            " / ".join(f"{ratio:.2f}" for ratio in row["over_bound"].values()),
            " / ".join(f"{bound:.2g}" for bound in row["bound"].values()),
            f"{100 * row['usable']:.1f} %",
            f"{100 * row['with_care']:.1f} %",
            " / ".join(f"{100 * held:.1f} %" for held in row["headline_held"].values()),
        )
        for row in rows
    ]
    who = {"FITTED_PLANT": "the step on the fitted plant", "METHOD": "the learner"}
    said = f"{rows[0]['recordings']} recordings each, seed {found['seed']}; metrics: {metrics}. "
    said += f"Answered by {who.get(found['answers'], 'the tuner')}."
    pieces = [table(heads, lines).strip(), said]
    if found["recipes"]:
        pieces.append("\n".join(["```text", *found["recipes"], "```"]))
    return "\n\n".join(pieces)
