"""The report's HTML page."""

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import yawrate_env
from tuners.cli.report import figures, loops, tables
from tuners.cli.report.figures import Traces
from tuners.cli.report.live import live
from tuners.cli.report.numbers import minus
from tuners.cli.report.residuals import Residuals
from tuners.cli.text import (
    VERDICTS,
    Shown,
    answered_by,
    described,
    displayed,
    fallback_text,
    forms_of,
    gain_units,
    in_words,
    vendors_rows,
)
from tuners.logs import Log
from tuners.tuner.method import Rung
from tuners.tuner.result import Result
from yawrate_env.files import write_text
from yawrate_env.plant.names import split, word
from yawrate_env.plant.plant import Plant

LONGEST_LAG = 0.05
"""Of the residual's correlations, in lengths of the experiment."""


def write_report(
    path: str | os.PathLike[str], result: Result, log: Log, tuner: str, logs: Sequence[Log] = ()
) -> None:
    """Write the page; the file is complete or not written."""
    write_text(path, render(result, log, tuner, logs))


def render(result: Result, log: Log, tuner: str, logs: Sequence[Log] = ()) -> str:
    """The page as text.

    Parameters
    ----------
    tuner : str
        Name or file, as the user gave it.
    logs : sequence of Log
        All of them, where there are several.
    """
    if logs:  # they are drawn one after the other
        log = replace(log, source=", ".join(one.source for one in logs), t0=0.0)
    plant, fit = result.plant, result.fit
    shown = displayed(plant)
    input, output = (in_words(names, kind) for names, kind in zip(shown, KINDS, strict=True))
    longest = LONGEST_LAG * plant.samples * plant.Ts
    residuals = Residuals.of(fit.residual, fit.u, fit.Ts, log.recorded_Ts, longest)
    loop, alone = result.loop, result.rung >= Rung.BLACK_BOX
    drawn = {
        **_recording(result, log),
        **_whole(result, log),
        **loops.pictured(loop, shown[1][0][0]),
        **_correlations(residuals, shown),
    }
    return _filled(
        verdict=VERDICTS[result.verdict].capitalize(),
        answered_by=answered_by(result),
        fitted="The black box that fits the recording best"
        if alone
        else "The plant of the simulator that fits the recording best",
        around="the response that the recording shows" if alone else "the fitted plant",
        title=_title(plant, log),
        result=result,
        described=f"{len(logs)} logs" if logs else described(log, plant),
        recordings=tables.recordings(result, logs),
        validation=tables.validation(result),
        tuner=tuner,
        input=input,
        output=output,
        instead=minus(fallback_text(result.fallback, gain_units(plant))),
        numbers=tables.numbers(result),
        fit=fit,
        loop=loop,
        live=live(result, log, tuner),
        responses=tuple(r.title for r in loop.responses) if loop and loop.responses else RESPONSES,
        margins=loops.margins(loop),
        parameters=tables.parameters(result),
        outside=residuals.outside,
        correlations=[name for name in drawn if name.startswith(("auto", "cross"))],
        forms=forms_of(result),
        vendors=vendors_rows(result),
        by_loop=tables.loops(result),
        units=gain_units(plant),
        checks=tables.checks(result),
        setup=tables.setup(result, log, tuner, logs),
        svg={name: figures.svg(picture, name, _seen(name)) for name, picture in drawn.items()},
    )


KINDS = "input", "output"
PICTURES = {
    "whole": "The whole log, and the part of it that is used",
    "bode": "Magnitude and phase of the open loop, and its margins",
}
RECORDING = "Input, measured and simulated output, and residual over time"
LOOP = "Responses of the closed loop over time"
AUTO = "Correlation of the residual with itself, and the band of white noise"
CROSS = "Correlation of the residual with the input, and its band"
"""What pictures show, for whom cannot see them."""

RESPONSES = "Step of the reference by 1", "Disturbance of the input by 1"
"""Titles of a loop's responses where the plant names none."""


def _seen(name: str) -> str:
    kinds = {"responses": LOOP, "auto": AUTO, "cross": CROSS}
    found = (text for start, text in kinds.items() if name.startswith(start))
    return PICTURES.get(name) or next(found, RECORDING)


def _title(plant: Plant, log: Log) -> str:
    """As in ``Yaw-rate controller from log.csv``."""
    output = in_words(displayed(plant)[1], "").replace(" ", "-").replace("-and-", " and ")
    return tables.capital(f"{output} controller from {log.source}".lstrip())


def _recording(result: Result, log: Log) -> dict[str, Any]:
    """Recording and fitted plant, for wide and for narrow pages."""
    fit, (inputs, outputs) = result.fit, displayed(result.plant)
    of_u, of_y = (np.array([factor for _, factor in each])[:, None] for each in (inputs, outputs))
    labels = tuple(name for name, _ in inputs), tuple(name for name, _ in outputs)
    u, measured, simulated = map(np.atleast_2d, (fit.u, fit.measured, fit.simulated))
    traces = Traces(log.t0, fit.Ts, of_u * u, of_y * measured, of_y * simulated, labels)
    return {
        "wide": figures.recording(traces, figures.FULL),
        "narrow": figures.recording(traces, figures.HALF),
    }


def _whole(result: Result, log: Log) -> dict[str, Any]:
    """The log that the recording is a part of."""
    if log.whole is None:
        return {}
    plant = result.plant
    labels = tuple(plant.label(name) for name in log.whole.measured)
    return {"whole": figures.whole(log.whole, displayed(plant)[0], labels, figures.FULL)}


def _correlations(residuals: Residuals, shown: tuple[Shown, Shown]) -> dict[str, Any]:
    """Each output's residual with itself, and with every input."""
    drawn, (inputs, outputs) = {}, shown
    for j, (auto, cross, (output, _)) in enumerate(
        zip(residuals.auto, residuals.cross, outputs, strict=True)
    ):
        residual = f"Residual of {split(output)[0]}" if len(outputs) > 1 else "Residual"
        drawn[f"auto_{j}"] = figures.correlation(auto, f"{residual} with itself")
        for i, (found, (input, _)) in enumerate(zip(cross, inputs, strict=True)):
            title = f"{residual} with the {word(input, 'input')}"
            drawn[f"cross_{j}_{i}"] = figures.correlation(found, title)
    return drawn


def _filled(**values: Any) -> str:
    """The template with its values."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("tuners.cli.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["minus"] = minus
    template = environment.get_template("page.html")
    return template.render(version=yawrate_env.__version__, **values) + "\n"
