"""The report's HTML page."""

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import yawrate_env
from tuners.cli.report import figures, loops, tables
from tuners.cli.report.figures import Traces
from tuners.cli.report.live import live
from tuners.cli.report.numbers import minus
from tuners.cli.report.residuals import Residuals
from tuners.cli.text import (
    VERDICTS,
    answered_by,
    described,
    displayed,
    fallback_text,
    forms_of,
    gain_units,
)
from tuners.logs import Log
from tuners.tuner.method import Rung
from tuners.tuner.result import Result
from yawrate_env.files import write_text
from yawrate_env.plant.names import word
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
    result.plant.check_single("reports draw", "Leave --report out.")
    if logs:  # they are drawn one after the other
        log = replace(log, source=", ".join(one.source for one in logs), t0=0.0)
    plant, fit = result.plant, result.fit
    shown = displayed(plant)
    input, output = (word(name, kind) for (name, _), kind in zip(shown, KINDS, strict=True))
    longest = LONGEST_LAG * len(plant.u) * plant.Ts
    residuals = Residuals.of(fit.residual, fit.u, fit.Ts, log.recorded_Ts, longest)
    loop, alone = result.loop, result.rung >= Rung.BLACK_BOX
    drawn = {
        **_recording(result, log),
        **_whole(result, log),
        **loops.pictured(loop, shown[1][0]),
        "auto": figures.correlation(residuals.auto, "Residual with itself"),
        "cross": figures.correlation(residuals.cross, f"Residual with the {input}"),
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
        residuals=residuals,
        forms=forms_of(result),
        units=gain_units(plant),
        checks=tables.checks(result),
        setup=tables.setup(result, log, tuner, logs),
        svg={name: figures.svg(picture, name, _seen(name)) for name, picture in drawn.items()},
    )


KINDS = "input", "output"
PICTURES = {
    "whole": "The whole log, and the part of it that is used",
    "bode": "Magnitude and phase of the open loop, and its margins",
    "auto": "Correlation of the residual with itself, and the band of white noise",
    "cross": "Correlation of the residual with the input, and its band",
}
RECORDING = "Input, measured and simulated output, and residual over time"
LOOP = "Responses of the closed loop over time"
"""What pictures show, for whom cannot see them."""

RESPONSES = "Step of the reference by 1", "Disturbance of the input by 1"
"""Titles of a loop's responses where the plant names none."""


def _seen(name: str) -> str:
    return PICTURES.get(name) or (LOOP if name.startswith("responses") else RECORDING)


def _title(plant: Plant, log: Log) -> str:
    """As in ``Yaw-rate controller from log.csv``."""
    output = word(displayed(plant)[1][0], "").replace(" ", "-")
    return tables.capital(f"{output} controller from {log.source}".lstrip())


def _recording(result: Result, log: Log) -> dict[str, Any]:
    """Recording and fitted plant, for wide and for narrow pages."""
    fit, ((input, of_u), (output, of_y)) = result.fit, displayed(result.plant)
    signals = of_u * fit.u, of_y * fit.measured, of_y * fit.simulated
    traces = Traces(log.t0, fit.Ts, *signals, (input, output))
    return {
        "wide": figures.recording(traces, figures.FULL),
        "narrow": figures.recording(traces, figures.HALF),
    }


def _whole(result: Result, log: Log) -> dict[str, Any]:
    """The log that the recording is a part of."""
    if log.whole is None:
        return {}
    (input, factor), plant = displayed(result.plant)[0], result.plant
    labels = tuple(plant.label(name) for name in log.whole.measured)
    return {"whole": figures.whole(log.whole, input, factor, labels, figures.FULL)}


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
