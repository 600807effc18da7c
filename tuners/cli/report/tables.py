"""Rows of the page's tables."""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any

from tuners.cli.report.numbers import minus
from tuners.cli.text import (
    between,
    described,
    displayed,
    every,
    fit_percent,
    gain_units,
    metric_name,
    quantity,
    unit_of,
)
from tuners.logs import Log
from tuners.trust.verdict import Check
from tuners.tuner.result import Result
from yawrate_env.plant.names import check_name, split
from yawrate_env.plant.plant import Plant

CHECKS = {
    "implausible": "Largest input or output over what is plausible",
    "between": "Output lost between slow samples",
    "noise": "Residual over simulated output",
    "misfit": "Output that no plant of the simulator reproduces",
    "response": "Response off the fitted plant's",
    "outside": "Fitted plant outside the prior, in widths of it",
    "colour": "Residual's power at the crossover, over white noise",
    "vague": "Spread over what needs no care, where the plant is contradicted",
    "disturbed": "The same power, where the plant is contradicted",
    "lingering": "Start's response that lasts too long, over the output",
    "bend": "Small amplitudes off the recording's, in metrics' limits",
    "halves": "Halves of the recording off the whole, in metrics' limits",
    "feedback": "Answer of the input to the output, in standard deviations",
    "reference": "Answer of the reference to the output, in standard deviations",
    "limited": "Share of the phase margin that is given up",
    "parts": "Spread between parts of the recording, over the widest",
    "sticking": "Metrics moved by an actuator that sticks or lags, over a miss",
    "louder": "Residual over the noise that the plant declares",
    "pattern": "Residual with a pattern, over simulated output",
    "undesigned": "No gains for the fitted plant",
    "stretched": "The experiment's samples at another sampling time",
    "unsolved": "Design or numerics failed",
    "logs": "Logs that disagree, in metrics' limits",
    "extrapolated": "Distance from the logs' operating points, in ranges",
}
"""Checks of every plant, as tables name them."""


def numbers(result: Result) -> list[tuple[str, str, str, str]]:
    """Gains and metrics: name, value, unit, and the interval below."""
    units = gain_units(result.plant)
    gains = [
        (split(name)[0], minus(quantity(value, "")), units[name] if isfinite(value) else "", "")
        for name, value in result.gains.items()
    ]
    metrics = []
    for name, interval in result.intervals.items():
        unit = {"deg": "°"}.get(unit_of(name), unit_of(name))
        value, _, below = minus(between(interval, unit).replace(" °", "°")).partition(", ")
        below = below.replace(" %", "\N{NO-BREAK SPACE}%") or "the recording does not tell"
        metrics.append((capital(metric_name(name)), value, "", below))
    return gains + metrics


def loops(result: Result) -> list[tuple[str, str]]:
    """Several PI loops: from which output to which input, and the gains of each."""
    pairs = zip(list(result.gains.items())[::2], list(result.gains.items())[1::2], strict=False)
    units = gain_units(result.plant)
    return [
        (
            f"{split(output)[0]} by {split(input)[0]}",
            minus(", ".join(f"{split(n)[0]} {quantity(v, units[n])}" for n, v in pair)),
        )
        for (input, output), pair in zip(result.plant.loops.values(), pairs, strict=False)
    ]


def parameters(result: Result) -> list[tuple[str, str, str]]:
    """Parameters of the fitted plant: name, value, and how it is known."""
    plant, deviations, rows = result.plant, result.fit.deviations, []
    for name, value in result.fit.parameters.items():
        low, high = plant.prior[name]
        prior = f"{low:.4g} to {high:.4g}"
        if name in deviations:
            known = f"estimated, standard deviation {deviations[name]:.2g}; prior {prior}"
        elif name in plant.measured:
            known = f"measured; the tuner was made for {prior}" if low < high else "measured"
        else:
            known = "known"
        label, unit = split(plant.label(name))
        rows.append((label, minus(quantity(value, unit)), minus(known)))
    return rows


def checks(result: Result) -> list[tuple[Check, str, str]]:
    """Checks with their names and units for people."""
    names = _check_names(result.plant)
    return [(c, *names.get(c.name, (c.name.replace("_", " "), ""))) for c in result.checks]


def recordings(result: Result, logs: Sequence[Log]) -> list[tuple[str, str, str, str, bool]]:
    """Several logs: name, share of the information, what it is, how it disagrees, and if not."""
    return [
        (
            log.source,
            f"{share.share:.0%}",
            minus(described(log, result.plant)),
            minus(share.sentence()),
            share.agrees,
        )
        for log, share in zip(logs, result.logs, strict=True)
    ]


def validation(result: Result) -> list[tuple[str, str]]:
    """A further log held against the result: name and value of each line."""
    held = result.validation
    if held is None:
        return []
    rows = [("Verdict", minus(held.sentence)), ("Fit", fit_percent(held))]
    for name, interval in held.intervals.items():
        rows.append((capital(metric_name(name)), minus(between(interval, unit_of(name)))))
    return rows


def setup(result: Result, log: Log, tuner: str, logs: Sequence[Log] = ()) -> list[tuple[str, str]]:
    """What the result rests on: tuner, plant, target, recordings."""
    plant, fit = result.plant, result.fit
    (_, outputs), target = displayed(plant), plant.parametrisation.target
    rows = [("Tuner", tuner), ("Plant", plant.entry or "without an entry point")]
    rows += [
        (capital(name), _listed(value))
        for name, value in plant.arguments.items()
        if value and name != "target"
    ]
    signals = plant.inputs_named, plant.outputs_named
    rows.append(("Signals", " to ".join(", ".join(names) for names in signals)))
    if target is not None:
        rows.append(("Target", f"phase margin {target.phase_margin:g}°, crossover "
                     f"{target.crossover:g} Hz"))  # fmt: skip
        rows.append(("Controller", f"{every(target.Ts)}, delay {target.delay_samples} samples"))
    rows.append(("Experiment trained on", f"{plant.samples * plant.Ts:g} s, {every(plant.Ts)}"))
    for one in logs or (log,):
        mark = f" {one.source}" if logs else ""
        rows.append((f"Recording{mark}", f"{one.duration:.4g} s, {every(one.recorded_Ts)}"))
        for name, values in one.measured.items():
            label, unit = split(plant.label(name))
            ends = f"from {values.min():.4g} to {values.max():.4g}"
            rows.append(
                (f"{capital(label)}{mark}", f"{quantity(float(values.mean()), unit)}, {ends}")
            )
    start = "from rest, without offset"
    if not fit.from_rest:
        units, factor = {unit_of(name) for name, _ in outputs}, outputs[0][1]
        unit = "" if len(units) > 1 else units.pop()
        offset, initial = (quantity(factor * v, unit, 3) for v in (fit.offset, fit.initial))
        start = f"in motion; offset {offset}, response to the initial state {initial} rms"
    rows += [("Start", start), ("Signal to noise", f"{fit.snr_db:.1f} dB")]
    return [(name, minus(value) if name in ("Start", "Signal to noise") else value)
            for name, value in rows]  # fmt: skip


def capital(words: str) -> str:
    """With a capital first letter."""
    return words[:1].upper() + words[1:]


def _check_names(plant: Plant) -> dict[str, tuple[str, str]]:
    """Names and units of a plant's checks, by the checks' own names."""
    named = {name: (words, "") for name, words in CHECKS.items()}
    for parameter in plant.measured:
        label, unit = split(plant.label(parameter))
        named[label] = f"{capital(label)} outside the tuner's range", unit
    for metric in plant.counted:
        words, unit = metric_name(metric), unit_of(metric)
        named[check_name(metric, "spread")] = f"Standard deviation of the {words}", unit
        named[check_name(metric, "contrast")] = (
            f"{capital(words)} between fitted plant and recording",
            unit,
        )
        named[check_name(metric, "error")] = f"{capital(words)} off its target", unit
    return named


def _listed(value: Any) -> str:
    """A JSON value in one line: ``M_0 1895, J_z 2400``."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_listed(item)}" for name, item in value.items())
    if isinstance(value, list | tuple):
        return " to ".join(map(_listed, value))
    return f"{value:g}" if isinstance(value, float) else str(value)
