"""The page ``results/robustness.md`` and its JSON, from the rows of `studies.robustness`."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from studies.degree import CONDITION, Level
from studies.markdown import general, table
from studies.robustness import PLAYERS, Row, plain, pooled
from studies.trusting import MISS
from tuners.trust.intervals import LEVEL
from yawrate_env.files import write_text

_PAGE = """\
# Who breaks where

Made by `scripts/robustness.py`; edits are overwritten. The same for programs, with every condition
on its own: [robustness.json](robustness.json).

`{tuner}` is given recordings of vehicles that are not what it takes them for, of drives and sensors
with defects, and logs with faults, {count} of each kind under each of {conditions}. Its **learner**
alone, the simulator **fitted** to the recording, the **black box** that knows no simulator, and the
**ladder** of the three, which is what `tune` answers with, are judged with the true vehicle. A
**miss** is a loop that is unstable, or farther than {phase_margin:g}° or {crossover:g} Hz from the
target; where no PI reaches the target, from what the design rule reaches with the true vehicle.

The true vehicle is the linear one as the recording starts: what changes on the way, and a deadband,
play or limit of the actuator, are in the recording and not in the loop. How severe a fault is, its
step says (`vehicle_steps.py`, `signal_steps.py` and `log_steps.py` in `scripts/studies/`).

{pooled}
{sentences}

![Who misses, and what the verdicts say, kind by kind](../figures/robustness.png)

The intervals are those of 90 % for phase margin and crossover, of answers that are not refused;
the rms is that of answers that neither miss nor are refused. Rungs say who answered: learner /
fitted plant / black box / nobody.

## By how much the vehicle's data may be wrong

![Accuracy, intervals and verdicts over the degree of wrongness](../figures/robustness_degree.png)

All of the vehicle's data are wrong, each by up to the degree and either way; {level}, {each}
recordings at each degree. Intervals of learner and fitted plant take the data for exact, and are as
narrow as that allows; those of black box and ladder rest on the recording alone.

{degrees}
{groups}"""

_HEADS = (
    "recordings", "target in reach", *(f"{name} misses" for name in PLAYERS),
    "usable / with care / refused", "misses called usable", "misses called usable with care",
    "rms [°]", "rms [Hz]", "intervals hold", "rungs",
)  # fmt: skip


def write(
    rows: Sequence[Row], levels: Sequence[Level], conditions: dict[str, Any], results: Path
) -> None:
    """Write ``robustness.json`` and ``robustness.md`` into a folder that exists."""
    found = {
        "conditions": conditions,
        "rows": plain(rows),
        "degrees": [asdict(level) for level in levels],
    }
    write_text(results / "robustness.json", json.dumps(found, indent=1, allow_nan=False) + "\n")
    write_text(results / "robustness.md", page(rows, levels, conditions))


def read(found: dict[str, Any]) -> tuple[list[Row], list[Level], dict[str, Any]]:
    """What `write` wrote, from its JSON."""
    rows = [Row(**r) for r in found["rows"]]
    return rows, [Level(**r) for r in found["degrees"]], found["conditions"]


def page(rows: Sequence[Row], levels: Sequence[Level], conditions: dict[str, Any]) -> str:
    """Build the page."""
    groups = {group: [r for r in rows if r.group == group] for group in _distinct(rows, "group")}
    together = [pooled(of, group, "") for group, of in groups.items()]
    sections = [f"## Kinds: {group}\n\n{_kinds(of)}" for group, of in groups.items()]
    names = _distinct(rows, "condition")
    return _PAGE.format(
        tuner=conditions["tuner"],
        count=conditions["recordings"],
        conditions=_listed(names),
        phase_margin=MISS[0],
        crossover=MISS[1],
        pooled=table(("group", *_HEADS), [(r.group, *_cells(r)) for r in together]),
        sentences=_sentences(rows, names),
        level=CONDITION.name,
        each=levels[0].recordings if levels else 0,
        degrees=_degrees(levels),
        groups="\n".join(sections),
    )


def summary(rows: Sequence[Row], conditions: dict[str, Any]) -> str:
    """How it was counted, and the groups in a few columns, as docs/accuracy.md shows them."""
    groups = dict.fromkeys(r.group for r in rows)
    lines = []
    for group in groups:
        of = pooled([r for r in rows if r.group == group])
        verdicts = " / ".join(_share(n, of.recordings) for n in of.verdicts.values())
        held = " / ".join(_share(n, of.trusted) for n in of.covered)
        missed = of.missed["usable"], of.missed["usable_with_care"]
        shares = (_share(of.misses[name], of.recordings) for name in ("learner", "ladder"))
        lines.append((group, of.recordings, *shares, verdicts, *missed, held))
    heads = (
        "what is wrong", "recordings", "learner misses", "ladder misses",
        "usable / with care / refused", "misses called usable", "with care", "intervals hold",
    )  # fmt: skip
    kinds = {r.kind for r in rows} - {"nothing"}
    counted = (
        f"{len(kinds)} kinds, {conditions['recordings']} recordings of each under "
        f"each of {_listed(_distinct(rows, 'condition'))}; a miss is unstable, or more than "
        f"{MISS[0]:g}° or {MISS[1]:g} Hz from what the design rule reaches on the true vehicle; "
        f"intervals are those of {LEVEL:.0%}."
    )
    return f"{counted}\n\n{table(heads, lines)}"


def _sentences(rows: Sequence[Row], names: Sequence[str]) -> str:
    """What the figures say, and under which conditions."""
    real = [r for r in rows if r.kind != "nothing"] or rows
    everything = pooled(real)
    learner, ladder = (everything.misses[name] for name in ("learner", "ladder"))
    parts = [
        f"Of {everything.recordings} recordings with a fault, the learner alone misses {learner} "
        f"({_share(learner, everything.recordings)}) and the ladder {ladder} "
        f"({_share(ladder, everything.recordings)}). Of the ladder's misses it calls "
        f"{everything.missed['usable']} usable, {everything.missed['usable_with_care']} usable "
        f"with care, and refuses {everything.missed['refuse']}."
    ]
    for name in names:
        here = pooled([r for r in real if r.condition == name])
        wrong = here.missed["usable"]
        parts.append(
            f"At {name}: misses called usable {wrong} of {here.verdicts['usable']} answers called "
            f"so ({_share(wrong, here.verdicts['usable'])}), misses called usable with care "
            f"{here.missed['usable_with_care']} of {here.verdicts['usable_with_care']} "
            f"({_share(here.missed['usable_with_care'], here.verdicts['usable_with_care'])})."
        )
    asked = [r for r in real if r.asked is not None]
    if asked:
        of = pooled(asked)
        careful = of.verdicts["usable_with_care"]
        parts.append(
            f"Of {careful} answers usable with care where the fault is only the log's, {of.asked} "
            f"({_share(of.asked or 0, careful)}) come with a question among the "
            "reasons."
        )
    return "\n".join(f"- {part}" for part in parts)


def _kinds(rows: Sequence[Row]) -> str:
    """A row each kind, all conditions together, and the conditions' misses beside."""
    asked = any(r.asked is not None for r in rows)
    heads = ("fault", *_HEADS, *(("asked",) if asked else ()))
    cells = []
    for kind in _distinct(rows, "kind"):
        of = pooled([r for r in rows if r.kind == kind])
        cells.append((kind, *_cells(of), *((of.asked,) if asked else ())))
    return table(heads, cells) + "\n" + _by_condition(rows)


def _by_condition(rows: Sequence[Row]) -> str:
    """Misses of learner and ladder, and of the latter those called usable, by condition."""
    names = _distinct(rows, "condition")
    heads = ("learner misses / ladder misses / of these usable / with care", *names)
    cells: list[tuple[str, ...]] = []
    for kind in _distinct(rows, "kind"):
        here = {r.condition: r for r in rows if r.kind == kind}
        cells.append((kind, *(_short(here[name]) if name in here else "" for name in names)))
    return table(heads, cells)


def _short(r: Row) -> str:
    counts = r.misses["learner"], r.misses["ladder"], r.missed["usable"]
    return " / ".join(map(str, (*counts, r.missed["usable_with_care"])))


def _cells(r: Row) -> list[str]:
    """Those of `_HEADS`."""
    size = [general(v) if r.good else "–" for v in r.rms]
    held = [_share(c, r.trusted) for c in r.covered]
    return [
        str(r.recordings),
        _share(r.reachable, r.recordings),
        *(_share(r.misses[name], r.recordings) for name in PLAYERS),
        " / ".join(_share(v, r.recordings) for v in r.verdicts.values()),
        str(r.missed["usable"]),
        str(r.missed["usable_with_care"]),
        *size,
        " / ".join(held),
        " / ".join(str(v) for v in r.rungs.values()),
    ]


def _degrees(levels: Sequence[Level]) -> str:
    heads = ("player", "wrong by up to", "misses", "rms [°]", "intervals hold", "usable",
             "usable with care")  # fmt: skip
    ordered = [x for name in PLAYERS for x in levels if x.player == name]
    return table(
        heads,
        [
            (x.player, f"{x.degree:g} %", _share(x.misses, x.recordings), general(x.rms),
             *(f"{100 * v:.3g} %" for v in (x.covered, x.usable, x.careful)))
            for x in ordered
        ],
    )  # fmt: skip


def _share(count: int, of: int) -> str:
    return f"{100 * count / of:.3g} %" if of else "–"


def _listed(names: Sequence[str]) -> str:
    *some, last = names
    return f"{'; '.join(some)} and {last}" if some else last


def _distinct(rows: Sequence[Row], name: str) -> list[str]:
    return list(dict.fromkeys(getattr(row, name) for row in rows))
