"""From an answer about a plant to its page."""

import os

import numpy as np

from tuners.cli.report import loops
from tuners.cli.report.figures import Traces
from tuners.cli.report.layout import Residuals, page, pictures, rows, shown_interval
from tuners.cli.report.numbers import minus
from tuners.cli.text import best, every
from tuners.logs.plant_log import PlantLog
from tuners.tuner.plant_result import PlantResult
from tuners.tuner.plant_tuner import PlantTuner
from yawrate_env.files import write_text
from yawrate_env.plant.names import check_name, split, valued, word
from yawrate_env.plant.plant import Plant
from yawrate_env.plant.responses import ClosedLoop

LONGEST_LAG = 0.05
"""In lengths of the experiment."""

CHECKS = {
    "implausible": ("Input or output over what can be", ""),
    "between": ("Output that is lost between slow samples", ""),
    "noise": ("Residual over simulated output", ""),
    "misfit": ("Output that no plant explains", ""),
    "response": ("Response off the fitted plant's", ""),
    "outside": ("Plant outside the prior, in widths of it", ""),
    "colour": ("Residual's power at the crossover, over white", ""),
    "unsolved": ("Design or numerics failed", ""),
}
"""Names and units for people, of what is asked of every plant."""


def write_plant_report(
    path: str | os.PathLike[str], result: PlantResult, log: PlantLog, made: PlantTuner, tuner: str
) -> None:
    """Write the page, completely or not at all."""
    write_text(path, render_plant(result, log, made, tuner))


def render_plant(result: PlantResult, log: PlantLog, made: PlantTuner, tuner: str) -> str:
    """The page as text.

    Parameters
    ----------
    made : PlantTuner
        What answered.
    tuner : str
        What the user calls it.
    """
    plant, fit = made.plant, result.fit
    words = [word(*of) for of in zip(plant.signals, ("input", "output"), strict=True)]
    longest = LONGEST_LAG * len(plant.u) * plant.Ts
    residuals = Residuals.of(fit.residual, fit.u, fit.Ts, log.Ts, longest)
    traces = Traces(log.t0, fit.Ts, fit.u, fit.measured, fit.simulated, plant.signals)
    loop = _loop(result, plant)
    return page(
        "plant.html",
        title=f"Gains from {log.source}",
        result=result,
        log=log,
        tuner=tuner,
        subject="plant",
        input=words[0],
        output=words[1],
        numbers=_numbers(result),
        instead=best(result.fallback),
        parameters=_parameters(result, plant),
        assumed=_assumed(result, log, made, tuner),
        notes=(*log.notes, *result.notes),
        checks=rows(result.checks, _checks(plant)),
        fit=fit,
        loop=loop,
        margins=loops.margins(loop),
        residuals=residuals,
        svg=pictures(traces, residuals, words[0], **loops.pictured(loop, plant.signals[1])),
    )


def _loop(result: PlantResult, plant: Plant) -> ClosedLoop | None:
    """Of the gains around the plant that was fitted."""
    theta = np.array([result.parameters[name] for name in plant.prior])
    return plant.closed(theta, np.array([result.gains[name] for name in plant.gains]))


def _numbers(result: PlantResult) -> list[tuple[str, str, str, str]]:
    gains = [(name, minus(f"{value:.4g}"), "", "") for name, value in result.gains.items()]
    figures = []
    for name, interval in result.metrics.items():
        words, unit = split(name)
        shown = {"deg": "°"}.get(unit, f" {unit}" if unit else "")
        figures.append(shown_interval(_capital(words), interval, shown))
    return gains + figures


def _parameters(result: PlantResult, plant: Plant) -> list[tuple[str, str, str]]:
    deviations, table = result.fit.deviations, []
    for name, value in result.parameters.items():
        low, high = plant.prior[name]
        made = f"{low:.4g} to {high:.4g}"
        if name in deviations:
            words = f"found, with a standard deviation of {deviations[name]:.2g}; prior {made}"
        elif name in plant.measured:
            words = f"measured; the tuner was made for {made}" if low < high else "measured"
        else:
            words = "known"
        table.append((name, minus(f"{value:.4g}"), minus(words)))
    return table


def _checks(plant: Plant) -> dict[str, tuple[str, str]]:
    """Of every plant, of its measured parameters and of its figures."""
    named = {}
    for name in plant.measured:
        words, unit = split(name)
        named[name] = f"{_capital(words)} outside what the tuner was made for", unit
    for figure in plant.metrics:
        words, unit = split(figure)
        off = f"{_capital(words)} off what the design rule reaches"
        named[check_name(figure, "spread")] = f"Standard deviation of the {words}", unit
        named[check_name(figure, "error")] = off, unit
    return CHECKS | named


def _assumed(
    result: PlantResult, log: PlantLog, made: PlantTuner, tuner: str
) -> list[tuple[str, str]]:
    plant, fit = made.plant, result.fit
    offset = minus(f"{fit.offset:.3g} {split(plant.signals[1])[1]}".rstrip())
    start = "from rest, without offset" if fit.from_rest else f"anywhere; offset {offset}"
    known = ", ".join(valued(*measured) for measured in log.measured.items())
    return [
        ("Tuner", tuner),
        ("Plant", plant.entry or "without an entry point"),
        ("Signals", " to ".join(plant.signals)),
        ("Experiment trained on", f"{len(plant.u) * plant.Ts:g} s, {every(plant.Ts)}"),
        ("Recording", f"{log.duration:g} s, {every(log.Ts)}"),
        *([("Measured beside it", known)] if known else []),
        ("Start", start),
        ("Signal to noise", minus(f"{fit.snr_db:.1f} dB")),
    ]


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]
