"""Slower and faster loops than the answer's, with the margins of each."""

import math
from typing import Any

import click
import numpy as np

from tuners.cli.answer import bare, plain
from tuners.cli.text import gain_units, quantity
from tuners.tuner.method import Rung
from tuners.tuner.result import Result
from yawrate_env.loop.margins import Margins
from yawrate_env.plant.names import split

HEADS = {
    "phase_margin": ("phase margin", "deg"),
    "crossover": ("crossover", "Hz"),
    "gain_margin": ("gain margin", "dB"),
    "delay_margin": ("delay margin", "s"),
    "modulus_margin": ("modulus margin", ""),
}
"""Margins, their words and units."""


def speeds(result: Result) -> dict[str, dict[str, Any]]:
    """Gains and margins of loops by the names of their speeds, around the fitted plant.

    Raises
    ------
    click.UsageError
        The plant knows no speeds of its rule, or no fitted plant answers.
    """
    plant = result.plant
    if plant.speeds is None or plant.loop is None:
        raise click.UsageError(
            "--speeds: this tuner's plant has a rule of one speed. Leave it out."
        )
    if result.rung >= Rung.BLACK_BOX:
        return {}
    theta = np.array(list(result.fit.parameters.values()))
    return {name: _one(result, theta, np.asarray(gains))
            for name, gains in plant.speeds(theta).items()}  # fmt: skip


def _one(result: Result, theta: Any, gains: Any) -> dict[str, Any]:
    drawn = result.plant.closed_loop(theta, gains)
    margins = None if drawn is None or drawn.open is None else drawn.open.marked
    return {
        "gains": dict(zip(result.plant.gains, gains.tolist(), strict=True)),
        "stable": drawn is not None and drawn.stable,
        "margins": {name: _value(margins, name) for name in HEADS},
    }


def _value(margins: Margins | None, name: str) -> float:
    return math.nan if margins is None else float(getattr(margins, name)[0])


def speeds_json(found: dict[str, dict[str, Any]]) -> Any:
    """As plain JSON values."""
    return plain({name: one | {"gains": bare(one["gains"])} for name, one in found.items()})


def speeds_text(result: Result, found: dict[str, dict[str, Any]]) -> str:
    """An aligned table, a column for each speed."""
    if not found:
        return "Speeds: none, since no fitted plant answers."
    units = gain_units(result.plant)
    rows = [["", *(name if one["stable"] else f"{name} (UNSTABLE)" for name, one in found.items())]]
    for name in result.plant.gains:
        values = (quantity(one["gains"][name], units[name]) for one in found.values())
        rows.append([split(name)[0], *values])
    for name, (words, unit) in HEADS.items():
        values = (quantity(one["margins"][name], unit) for one in found.values())
        rows.append([words, *values])
    widths = [max(len(row[i]) for row in rows) + 2 for i in range(len(rows[0]))]
    lines = ("".join(f"{cell:<{w}}" for cell, w in zip(row, widths, strict=True)) for row in rows)
    return "\n".join(["Speeds", *(f"  {line.rstrip()}" for line in lines)])
