"""The tables of `studies.off_design`, as JSON and as a page."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

import msgspec

from studies.conditions import SWEEPS, Level
from studies.markdown import general, table
from studies.off_design import Accuracy, Cell
from studies.players import CLIMBER, LADDER
from studies.trusting import MISS
from yawrate_env.files import write_text

_PAGE = """\
# Off the design point

Every tuner gets the same {episodes} episodes of the `test` set (seed {seed}) under every
condition, and keeps what it was made for; learners answer with their own gains. {ladder}What is off
is the true vehicle, relative to the one that the tuners know. Errors are root mean squares of the
distance from the target on the true vehicle, over the stable loops; their 95 % bootstrap intervals
are in `off_design.json`. A miss is a loop that is unstable, or farther from the target than
{phase_margin:g}° or {crossover:g} Hz. The Cramér–Rao bound, over the same episodes, is given where
it bounds the tuners: white noise, and all but friction and mass known. In brackets: the error as a
multiple of it.

Offsets and starts in mid-drive are taken out as `tune` does it. A recording of a second or two says
little of either: a few that start from rest are taken for such a start, and their errors, most of
them refused, make most of the root mean square there.

## Phase margin: rms error [°] (× the bound)

{phase_margins}
## Crossover: rms error [Hz] (× the bound)

{crossovers}
## Trust: gains trusted / unstable loops / misses / misses that were trusted

{trust}{refusals}"""

_LADDER = (
    f"`{LADDER}` is `{CLIMBER}` with the fitted simulator and the black box to fall back on, as "
    "`tune` has them.\n"
)


def write(cells: Sequence[Cell], seed: int, folder: Path) -> None:
    """Write ``off_design.json`` and ``off_design.md`` into a folder that exists."""
    found = {"conditions": _conditions(cells, seed), "cells": [asdict(c) for c in cells]}
    text = json.dumps(found, indent=1, allow_nan=False)
    write_text(folder / "off_design.json", text + "\n")
    write_text(folder / "off_design.md", page(cells, seed))


def read(folder: Path) -> tuple[list[Cell], int]:
    """Cells and seed of ``off_design.json``."""
    found = json.loads((folder / "off_design.json").read_text("utf-8"))
    return msgspec.convert(found["cells"], list[Cell]), int(found["conditions"]["seed"])


def joined(folder: Path, cells: Sequence[Cell], seed: int) -> list[Cell]:
    """Stored cells, with new ones in place of the same tuner's or behind them.

    Raises
    ------
    ValueError
        If those were not measured on the same episodes and conditions.
    """
    stored, stored_seed = read(folder)
    asked = {(c.condition, c.level, c.episodes) for c in cells}
    if stored_seed != seed or {(c.condition, c.level, c.episodes) for c in stored} != asked:
        raise ValueError(
            f"keep: {folder / 'off_design.json'} has other episodes, seeds or conditions. "
            "Measure all tuners anew."
        )
    new = {c.tuner for c in cells}
    kept: dict[tuple[str, Level], list[Cell]] = {}
    for c in [*(c for c in stored if c.tuner not in new), *cells]:
        kept.setdefault((c.condition, c.level), []).append(c)
    return [c for row in kept.values() for c in row]


def _conditions(cells: Sequence[Cell], seed: int) -> dict[str, object]:
    return {
        "set": "test",
        "episodes": cells[0].episodes,
        "seed": seed,
        "miss": MISS,
        "interval": "95 % bootstrap",
    }


def page(cells: Sequence[Cell], seed: int) -> str:
    """One table each for phase margin, crossover and trust."""
    ladder = any(c.tuner == LADDER for c in cells)
    refusals = [
        f"- `{c.tuner}`, {c.condition}: {shown_level(c.level)}: {c.refused}"
        for c in cells
        if c.refused
    ]
    return _PAGE.format(
        episodes=cells[0].episodes,
        ladder=_LADDER if ladder else "",
        seed=seed,
        phase_margin=MISS[0],
        crossover=MISS[1],
        phase_margins=_accuracies(cells, lambda c: c.phase_margin),
        crossovers=_accuracies(cells, lambda c: c.crossover),
        trust=_table(cells, {}, _trust),
        refusals="\n".join(["\n## Refused, in the tuners' words\n", *refusals, ""])
        if refusals
        else "",
    )


def _accuracies(cells: Sequence[Cell], of: Callable[[Cell], Accuracy]) -> str:
    return _table(
        cells, {"bound": lambda c: general(of(c).bound)}, lambda c: general(of(c).rms, of(c).ratio)
    )


def _trust(c: Cell) -> str:
    return f"{100 * c.trusted / c.episodes:.3g} % / {c.unstable} / {c.misses} / {c.trusted_misses}"


def _table(
    cells: Sequence[Cell], common: dict[str, Callable[[Cell], str]], text: Callable[[Cell], str]
) -> str:
    """Conditions down, tuners across after `common` columns; the design point once, on top."""
    names = list(dict.fromkeys(c.tuner for c in cells))
    rows: dict[tuple[str, Level], list[Cell]] = {}
    for c in cells:
        rows.setdefault((c.condition, c.level), []).append(c)
    design = {sweep.name: sweep.design for sweep in SWEEPS}
    titled = {
        "design point" if level == design[name] else f"{name}: {shown_level(level)}": row
        for (name, level), row in rows.items()
    }
    titled = {"design point": titled.get("design point", []), **titled}
    return table(
        ("condition", *common, *(f"`{name}`" for name in names)),
        [
            (
                title,
                *(f(row[0]) for f in common.values()),
                *("refused" if c.refused else text(c) for c in row),
            )
            for title, row in titled.items()
            if row
        ],
    )


def shown_level(level: Level) -> str:
    """Without needless digits."""
    return level if isinstance(level, str) else f"{level:g}"
