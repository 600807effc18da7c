"""Answers to the page about a log: how it was understood, its plot, the gains, files of it."""

import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import tuners
from tuners.app.form import command_line, parsed
from tuners.app.uploads import Answer, Upload
from tuners.cli import ERRORS, in_words
from tuners.cli.answer import as_json, plain
from tuners.cli.report import render
from tuners.cli.sources import load_tuner
from tuners.cli.target_options import changed
from tuners.cli.tuning import DEFAULT, for_loop, tuned, tuner_for
from tuners.export import export
from tuners.logs import Log, Options, Table, log_of, read_table
from tuners.logs.columns import Found, find
from tuners.logs.table import Array
from tuners.tuner.result import Result
from yawrate_env.loop.target import Target
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant

POINTS = 1500
"""Of the plot of a whole log, each the least and the largest value of a piece of it."""

EVERYTHING = -1e300, 1e300

tuner_called = cache(load_tuner)


def choices() -> dict[str, Any]:
    """What the form offers, once everything that an answer needs was imported."""
    tuner_called(DEFAULT)
    return {"tuners": list(tuners.NAMES), "default": DEFAULT}


def understood(upload: Upload, form: Mapping[str, Any]) -> dict[str, Any]:
    """Columns, roles, units, notes and the plot; and an error where the log cannot be used so."""
    try:
        table = _table(upload)
        told: dict[str, Any] = {"name": upload.name, "columns": list(table.names)}
    except ERRORS as error:
        return {"name": upload.name, "columns": [], "error": _said(error, upload)}
    try:
        options, _, chosen, changes = parsed(form, tuners.NAMES)
        told["command"] = command_line(form, upload.name)
        told["tuner"], trained, log = tuner_for(table, options, chosen, tuner_called)
        told["loop"] = _loop(trained.plant.loop_target)
        if changes:
            changed(trained.plant, changes)
    except ERRORS as error:
        return told | {"error": _said(error, upload)}
    whole = log
    if log.whole is not None:
        whole = log_of(table, trained.plant, _whole(options))
    return told | {
        "roles": _roles(find(table, trained.plant, options), trained.plant),
        "notes": list(log.notes),
        "stretch": [float(log.time[0]), float(log.time[-1])],
        "plot": _plot(whole, trained.plant),
    }


def answered(upload: Upload, form: Mapping[str, Any]) -> dict[str, Any]:
    """Tune, and keep the result for the report and the exports."""
    upload.answer = None
    try:
        options, start, chosen, changes = parsed(form, tuners.NAMES)
        name, trained, log = tuner_for(_table(upload), options, chosen, tuner_called)
        result = for_loop(
            trained, changes, lambda tuner: tuned(tuner, log, start, options.input_scale)
        )
    except ERRORS as error:
        return {"error": _said(error, upload)}
    told = as_json(result, log, name)
    upload.answer = Answer(result, told, render(result, log, name))
    return {"answer": told, "exports": _exports(result)}


def exported(upload: Upload, target: str) -> tuple[str, bytes]:
    """A file's ending and content; `KeyError` where there is no answer or no such target."""
    answer = upload.answer
    if answer is None:
        raise KeyError(target)
    if target == "report":
        return ".html", answer.report.encode()
    if target == "json":
        return ".json", json.dumps(answer.json, indent=1, allow_nan=False).encode()
    if target not in ("c", "matlab"):
        raise KeyError(target)
    with TemporaryDirectory() as folder:
        files = export(answer.result, target, Path(folder) / "yaw_pi.m")
        if target == "matlab":
            return ".m", files[0].read_bytes()
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            for file in files:
                archive.write(file, file.name)
        return ".zip", packed.getvalue()


def _table(upload: Upload) -> Table:
    """The log's columns, under the name that the user gave it."""
    if upload.table is None:
        upload.table = replace(read_table(upload.path), source=Path(upload.name))
    return upload.table


def _said(error: Exception, upload: Upload) -> str:
    return in_words(error).replace(str(upload.path), upload.name)


def _whole(options: Options) -> Options:
    return replace(options, start=EVERYTHING[0], stop=EVERYTHING[1])


def _loop(target: Target | None) -> dict[str, float]:
    """The loop that the tuner was made for, by the form's fields; empty where it has none."""
    if target is None:
        return {}
    return {
        "crossover": target.crossover,
        "phase-margin": target.phase_margin,
        "delay": target.delay_samples * target.Ts,
    }


def _roles(found: Found, plant: Plant) -> list[dict[str, Any]]:
    """Which column or value each role has, in which unit, and the plant's unit."""
    meant = {"input": plant.signals[0], "output": plant.signals[1], "reference": plant.signals[1]}
    meant |= {name: plant.label(name) for name in plant.measured}
    roles = []
    for key in ("time", *meant):
        words, unit = split(meant[key]) if key in meant else ("time", "s")
        column = found.quantities.get(key)
        roles.append(
            {
                "role": words if key in plant.measured else key,
                "words": "reference" if key == "reference" else words,
                "column": None if column is None else column.name,
                "unit": "" if column is None else column.unit or unit,
                "needed": unit,
                "value": found.values.get(key),
            }
        )
    return roles


def _plot(log: Log, plant: Plant) -> dict[str, Any]:
    """Input and output, thinned out."""
    time, u = thinned(log.time, log.u, POINTS)
    _, y = thinned(log.time, log.y, POINTS)
    labels = [" ".join((split(s)[0], f"[{split(s)[1]}]")) for s in plant.signals]
    told: dict[str, Any] = plain(
        {"time": time.tolist(), "input": u.tolist(), "output": y.tolist(), "labels": labels}
    )
    return told


def thinned(t: Array, x: Array, count: int) -> tuple[Array, Array]:
    """The least and the largest value of each of `count` pieces, at the piece's first times.

    Parameters
    ----------
    t, x : NDArray
        (N,) each; they come back as they are where N is at most 2 `count`.
    """
    if len(x) <= 2 * count:
        return t, x
    starts = np.linspace(0, len(x), count, endpoint=False).astype(np.intp)
    ends = np.stack([np.minimum.reduceat(x, starts), np.maximum.reduceat(x, starts)], axis=1)
    times = np.stack([t[starts], t[starts + 1]], axis=1)
    return times.ravel(), ends.ravel()


def _exports(result: Result) -> list[str]:
    """Targets that these gains allow."""
    targets = ["report", "json"]
    for target in ("c", "matlab"):
        try:
            with TemporaryDirectory() as folder:
                export(result, target, Path(folder) / "controller")
            targets.append(target)
        except ValueError:
            continue
    return targets
