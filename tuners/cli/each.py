"""Every log tuned by itself: one row a log, as CSV or Parquet."""

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import click

from tuners.cli.arguments import REFUSED, UNUSABLE
from tuners.cli.progress import Bars
from tuners.cli.text import RUNGS
from tuners.cli.tuning import tuned, tuner_and_log
from tuners.logs import Log, Options
from tuners.trust.verdict import Verdict
from tuners.tuner.result import Result
from tuners.tuner.tuner import Tuner
from yawrate_env.files import replacing, write_text
from yawrate_env.plant.names import split

Row = dict[str, Any]


def tune_each(
    files: Sequence[Path],
    options: Options,
    start: str,
    tuner: str | None,
    out: Path | None,
    strict: bool,
    load: Callable[[str], Tuner],
) -> int:
    """Tune logs one by one, write the table, and give the exit status.

    A log that cannot be used has its error in its row.
    """
    rows: list[Row] = []
    status, load = 0, cache(load)
    with Bars() as bars:
        for i, path in enumerate(files):
            bars("logs", i, len(files))
            try:
                row, enough = _row(path, options, start, tuner, strict, load)
                status = status if enough else status or REFUSED
            except (ValueError, OSError, MemoryError, OverflowError) as error:
                row = {"file": str(path), "error": " ".join(str(error).split())}
                status = UNUSABLE
            rows.append(row)
        bars("logs", len(files), len(files))
    table = _filled(rows)
    if out is None:
        click.echo(_as_csv(table), nl=False)
    elif out.suffix == ".parquet":
        _write_parquet(table, out)
    else:
        write_text(out, _as_csv(table))
    return status


def _row(
    path: Path,
    options: Options,
    start: str,
    name: str | None,
    strict: bool,
    load: Callable[[str], Tuner],
) -> tuple[Row, bool]:
    """One log's row, and whether its gains may be used."""
    chosen, trained, log = tuner_and_log(path, options, name, load)
    result = tuned(trained, log, start, options.input_scale)
    enough = result.verdict is Verdict.USABLE if strict else result.trusted
    return {"file": str(path), **_of(result, log), "tuner": chosen, "error": ""}, enough


def _of(result: Result, log: Log) -> Row:
    plant = result.plant
    row: Row = {"verdict": result.verdict.value, "answered_by": RUNGS[result.rung]}
    row |= {split(name)[0]: value for name, value in result.gains.items()}
    for name, interval in result.intervals.items():
        bare = split(name)[0]
        row |= {bare: interval.value, f"{bare}_low": interval.low, f"{bare}_high": interval.high}
    for name, values in log.measured.items():
        row[split(plant.label(name))[0]] = float(values.mean())
    return row | {
        "start": log.t0,
        "samples": log.u.shape[-1],
        "Ts": log.Ts,
        "reasons": " ".join(result.reasons),
        "notes": " ".join(result.notes),
    }


def _filled(rows: Sequence[Row]) -> list[Row]:
    """Rows with all columns in one order; None where a log has nothing."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    columns = [*(name for name in columns if name != "error"), "error"]
    return [{name: row.get(name) for name in columns} for row in rows]


def _as_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _write_parquet(rows: Sequence[Mapping[str, Any]], out: Path) -> None:
    import pyarrow
    from pyarrow import parquet

    with replacing(out) as file:
        parquet.write_table(pyarrow.Table.from_pylist(list(rows)), file)
