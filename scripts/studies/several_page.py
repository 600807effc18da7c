"""The tables of `studies.several`, as JSON and as a page."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from studies.markdown import short, table
from studies.several import Called, Gain, Pooled
from tuners.cli.answer import plain
from yawrate_env.files import write_text

_PAGE = """\
# Several logs of one vehicle

Made by `python scripts/several.py`; {sets} sets of each kind, seed {seed}, `{tuner}`. Every
recording has a random register, 10 s at 30 dB unless a row says otherwise.

## Pooling

Root mean square errors from one of four recordings, and from all four; the ideal ratio is 2.

{gains}
## Validation

A further recording is held against an answer from one recording, both at 20 m/s. It is called out
where its own answer or its whole response disagrees by more than chance, and contradicts the gains
where it also moves a metric by more than 1.5° or 0.075 Hz. A wrong car's friction is 0.2 off, or
one parameter 20 %.

{called}
## Disagreement

An eighth as many sets of four recordings of one car; in some kinds the last is another car's.
`named` counts the sets in which the other car's recording, and no other, is named; of kinds without
one, the sets in which none is. In the last kind every constant differs from the vehicle's data by
up to 5 %: recordings at several speeds then contradict one plant of these data, and those of the
wanted speed answer alone. Missed: trusted and off by 3° or 0.15 Hz.

{pooled}"""


def write(
    first: Sequence[Gain],
    second: Sequence[Called],
    third: Sequence[Pooled],
    given: dict[str, Any],
    folder: Path,
) -> None:
    """Write ``several.json`` and ``several.md`` into a folder that exists."""
    found = {
        "conditions": given,
        "pooling": [asdict(row) for row in first],
        "validation": [asdict(row) for row in second],
        "disagreement": [asdict(row) for row in third],
    }
    write_text(folder / "several.json", json.dumps(plain(found), indent=1, allow_nan=False) + "\n")
    write_text(folder / "several.md", page(found))


def page(found: dict[str, Any]) -> str:
    """The page from the stored numbers."""
    return _PAGE.format(
        **found["conditions"],
        gains=_gains([Gain(**row) for row in found["pooling"]]),
        called=_called([Called(**row) for row in found["validation"]]),
        pooled=_pooled([Pooled(**row) for row in found["disagreement"]]),
    )


def _gains(rows: Sequence[Gain]) -> str:
    heads = ("speeds [m/s]", "answered by", "one: phase margin [°]", "crossover [Hz]",
             "four: phase margin [°]", "crossover [Hz]", "ratio")  # fmt: skip
    return table(
        heads,
        [
            (r.speeds, r.answered_by, *map(short, r.one), *map(short, r.pooled),
             " / ".join(f"{x:.2f}" for x in r.ratio))
            for r in rows
        ],
    )  # fmt: skip


def _called(rows: Sequence[Called]) -> str:
    heads = ("car", "SNR [dB]", "length [s]", "called out", "contradicts",
             "rms change: phase margin [°]", "crossover [Hz]")  # fmt: skip
    return table(
        heads,
        [
            (r.kind, f"{r.snr_db:g}", f"{r.seconds:g}", f"{r.disagrees:.1%}",
             f"{r.contradicts:.1%}", short(r.phase_margin), short(r.crossover))
            for r in rows
        ],
    )  # fmt: skip


def _pooled(rows: Sequence[Pooled]) -> str:
    heads = ("last recording", "speeds [m/s]", "usable", "with care", "refused", "named", "missed",
             "90 % intervals hold")  # fmt: skip
    return table(
        heads,
        [
            (r.kind, r.speeds, r.usable, r.care, r.refused, f"{r.named} of {r.sets}", r.missed,
             " / ".join("–" if x is None or x != x else f"{x:.1%}" for x in r.covered))
            for r in rows
        ],
    )  # fmt: skip
