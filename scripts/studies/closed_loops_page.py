"""The page ``results/closed_loops.md`` and its JSON, from the rows of `studies.closed_loops`."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from studies.closed_loops import CONDITIONS, FIRST, MANOEUVRES, WAYS, Row
from studies.markdown import table
from studies.trusting import MISS
from yawrate_env.files import write_text

_PAGE = """\
# Recordings in a closed loop

Made by `scripts/closed_loops.py`; edits are overwritten. The same for programs:
[closed_loops.json](closed_loops.json).

Drives of 20 s under an old PI that is sluggish or has 5° to 20° of phase margin: steps of the
yaw-rate reference, lane changes, or a slow weave (0.15 to 0.35 Hz), a third each; any friction,
load and speed (10 to 33 m/s); 30 dB of gyro noise and up to 0.1° rms of disturbance at the
steering (bandwidth 0.3 to 5 Hz) act inside the loop. Controller and logger run at 100 Hz, the
recording begins in mid-drive. `{tuner}` tunes them with the reference, with the gains of the
controller that drove, and with neither. Seed {seed}.

**Within** is a loop within {phase_margin:g}° and {crossover:g} Hz of the target on the true
vehicle, whatever the verdict. A slow weave holds little at the crossover: the interval says so,
and the answer is refused. **Loop noticed** is a recording that was found to be in a closed loop,
or a reference that was found to answer the output.

{tables}"""

_HEADS = (
    "", "manoeuvre", "drives", "within", "usable", "with care", "bad and trusted", "loop noticed",
)  # fmt: skip


def write(rows: Sequence[Row], conditions: dict[str, Any], results: Path) -> None:
    """Write ``closed_loops.json`` and ``closed_loops.md`` into a folder that exists."""
    found = {"conditions": conditions, "rows": [asdict(row) for row in rows]}
    write_text(results / "closed_loops.json", json.dumps(found, indent=1, allow_nan=False) + "\n")
    write_text(results / "closed_loops.md", page(rows, conditions))


def read(found: dict[str, Any]) -> tuple[list[Row], dict[str, Any]]:
    """What `write` wrote, from its JSON."""
    return [Row(**row) for row in found["rows"]], found["conditions"]


def page(rows: Sequence[Row], conditions: dict[str, Any]) -> str:
    """Build the page."""
    sections = {FIRST: "The first forty", **CONDITIONS}
    parts = []
    for name, words in sections.items():
        chosen = [row for row in rows if row.condition == name]
        if chosen:
            parts.append(f"## {words}\n\n{table(_HEADS, _lines(chosen))}")
    return _PAGE.format(
        tuner=conditions["tuner"], seed=conditions["seed"], phase_margin=MISS[0],
        crossover=MISS[1], tables="\n".join(parts),
    )  # fmt: skip


def _lines(rows: Sequence[Row]) -> list[tuple[object, ...]]:
    lines: list[tuple[object, ...]] = []
    for way in WAYS:
        for kind in (*MANOEUVRES, "together"):
            some = [r for r in rows if r.way == way and kind in (r.manoeuvre, "together")]
            if some:
                lines.append((way, kind, *(sum(getattr(r, n) for r in some) for n in _COUNTS)))
    return lines


_COUNTS = "drives", "within", "usable", "with_care", "bad_and_trusted", "flagged"
