"""Counts of `studies.mutations` by outcome and format, as JSON and as a page."""

import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from studies.markdown import table
from studies.mutations import FORBIDDEN, REFUSED, RIGHT, UNTRUSTED, Case
from yawrate_env.files import write_text

OUTCOMES = RIGHT, UNTRUSTED, REFUSED, *FORBIDDEN

_PAGE = """\
# Damaged log files

Made by `python scripts/log_files.py hunt`; {count} damaged files, seed {seed}. Valid files of every
format are cut, bits are flipped, parts are lost, repeated or zeroed; in text, cells and rows are
swapped or replaced, and the encoding changes. Four in ten have two kinds of damage.

{table}
Forbidden are a traceback, more than 10 s of the processor, more than 2 GB, and a trusted answer
that the undamaged file contradicts: gains that miss its fitted plant's target by 3° or 0.15 Hz are
wrong, and intervals that do not overlap lie apart.

{forbidden}"""


def counted(cases: Iterable[Case], seed: int) -> dict[str, Any]:
    """Counts by format and outcome, and the forbidden cases."""
    cases = list(cases)
    formats: dict[str, Counter[str]] = {}
    for case in cases:
        formats.setdefault("".join(Path(case.source).suffixes), Counter())[case.outcome] += 1
    return {
        "conditions": {"count": len(cases), "seed": seed},
        "formats": {name: dict(counts) for name, counts in sorted(formats.items())},
        "forbidden": [asdict(case) for case in cases if case.outcome in FORBIDDEN],
    }


def merged(before: dict[str, Any], found: dict[str, Any]) -> dict[str, Any]:
    """Counts of a hunt's first part and of the next."""
    formats = {name: Counter(counts) for name, counts in before["formats"].items()}
    for name, counts in found["formats"].items():
        formats[name] = formats.get(name, Counter()) + Counter(counts)
    count = before["conditions"]["count"] + found["conditions"]["count"]
    return {
        "conditions": {"count": count, "seed": found["conditions"]["seed"]},
        "formats": {name: dict(counts) for name, counts in sorted(formats.items())},
        "forbidden": before["forbidden"] + found["forbidden"],
    }


def write(found: dict[str, Any], folder: Path) -> None:
    """Write ``log_files.json`` and ``log_files.md`` into a folder that exists."""
    write_text(folder / "log_files.json", json.dumps(found, indent=1) + "\n")
    write_text(folder / "log_files.md", page(found))


def summary(found: dict[str, Any]) -> str:
    """The outcomes in a sentence, as docs/cli.md shows them."""
    total: Counter[str] = Counter()
    for counts in found["formats"].values():
        total.update(counts)
    forbidden = sum(total[outcome] for outcome in FORBIDDEN)
    return (
        f"Of {found['conditions']['count']:,} files {total[REFUSED]:,} were refused in one line, "
        f"the gains of {total[UNTRUSTED]} were refused, and {total[RIGHT]:,} answers were right; "
        f"what must not be ({'; '.join(FORBIDDEN)}) came {forbidden} times."
    )


def page(found: dict[str, Any]) -> str:
    """The page from the stored numbers."""
    total: Counter[str] = Counter()
    for counts in found["formats"].values():
        total.update(counts)
    rows = [*found["formats"].items(), ("all", total)]
    counts = [(name, *(row.get(outcome, 0) for outcome in OUTCOMES)) for name, row in rows]
    listed = [
        f"- {c['source']}, seed {c['seed']} ({c['damage']}): {c['outcome']}, {c['words'][:160]}\n"
        for c in found["forbidden"]
    ]
    forbidden = "".join(listed) or "There is none of these.\n"
    given = found["conditions"]
    return _PAGE.format(**given, table=table(("file", *OUTCOMES), counts), forbidden=forbidden)
