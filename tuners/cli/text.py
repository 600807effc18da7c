"""A tuning result as text for people."""

import math
from collections.abc import Mapping, Sequence
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from tuners.export.forms import Forms, controller_of, vendors_forms
from tuners.logs import Log
from tuners.trust.intervals import Interval
from tuners.trust.verdict import Check, Verdict
from tuners.tuner.method import Rung
from tuners.tuner.pooling.share import Share, Validation
from tuners.tuner.result import Result
from yawrate_env.loop.controllers import CONTROLLERS
from yawrate_env.plant.names import split, valued, word
from yawrate_env.plant.plant import Plant

_TIMES = "Ti", "Td", "Tf", "T_lead", "T_lag"

RUNGS = {
    Rung.METHOD: "tuner",
    Rung.FITTED_PLANT: "fitted plant",
    Rung.BLACK_BOX: "black box",
    Rung.NONE: "none",
}
"""Whose gains a result has."""

_ANSWERED_BY_ALL = {
    Rung.METHOD: "the tuner's answers to all logs, weighted",
    Rung.FITTED_PLANT: "the plant fitted to all logs together",
    Rung.BLACK_BOX: "the logs' own responses together, without the plant's data",
    Rung.NONE: "nothing",
}

VERDICTS = {
    Verdict.USABLE: "USABLE",
    Verdict.USABLE_WITH_CARE: "USABLE WITH CARE",
    Verdict.REFUSE: "REFUSED",
}


def as_text(result: Result, log: Log, logs: Sequence[Log] = ()) -> str:
    """The verdict and its reasons, then aligned lines; metrics only where gains are usable.

    Parameters
    ----------
    logs : sequence of Log
        All of them, where there are several.
    """
    plant, forms = result.plant, forms_of(result)
    units = gain_units(plant)
    rows = [(split(name)[0], quantity(v, units[name])) for name, v in result.gains.items()]
    if result.trusted:
        rows += [(metric_name(n), between(i, unit_of(n))) for n, i in result.intervals.items()]
        rows.append(("from", answered_by(result)))
        if forms is not None:
            rows.append(("every", f"{1e3 * forms.Ts:g} ms: {forms.equation}"))
        rows += vendors_rows(result)
    width = max(len(name) for name, _ in rows) + 2
    table = [f"  {name:<{width}}{value}" for name, value in rows]
    reasons = [f"  - {explained(reason, result.checks)}" for reason in result.reasons]
    parts = [VERDICTS[result.verdict], *reasons, "", *table]
    if not result.trusted:
        parts += ["", fallback_text(result.fallback, units)]
    if result.validation is not None:
        parts += ["", *validated(result)]
    notes = ["", "Notes", *(f"  - {note}" for note in result.notes)] if result.notes else []
    return "\n".join([*_headed(result, log, logs), "", *parts, *notes])


def _headed(result: Result, log: Log, logs: Sequence[Log]) -> list[str]:
    """A line for each log, with its share of the information where there are several."""
    plant = result.plant
    if not logs:
        return [f"{log.source}: {described(log, plant)}"]
    width = max(len(one.source) for one in logs) + 1
    return [
        f"{f'{one.source}:':<{width}} {described(one, plant)}, {agreement(share)}"
        for one, share in zip(logs, result.logs, strict=True)
    ]


def agreement(share: Share) -> str:
    """What a log adds, and whether it agrees with the others."""
    disagrees = "" if share.agrees else ", DISAGREES"
    return f"{share.share:.0%} of the information{disagrees}"


def validated(result: Result) -> list[str]:
    """What a further log says of the answer."""
    held = result.validation
    if held is None:
        return []
    rows = [("fit", fit_percent(held))]
    rows += [(metric_name(n), between(i, unit_of(n))) for n, i in held.intervals.items()]
    width = max(len(name) for name, _ in rows) + 2
    return ["Validation", f"  {held.sentence}", *(f"  {n:<{width}}{v}" for n, v in rows)]


Shown = tuple[tuple[str, float], ...]
"""Names of signals for people, with their units, and the factors to these."""


def fit_percent(held: Validation) -> str:
    """Share of the output that is reproduced, and the share that can be."""
    return f"{held.fit:.1f} % of the output; a model of this log alone {held.attainable:.1f} %"


def answered_by(result: Result) -> str:
    """Whose gains these are."""
    if result.logs:
        return _ANSWERED_BY_ALL[result.rung]
    words = {
        Rung.METHOD: "the tuner, confirmed by the plant fitted to the recording",
        Rung.FITTED_PLANT: "the plant fitted to the recording",
        Rung.BLACK_BOX: "the recording's own response, without the plant's data",
        Rung.NONE: "nothing",
    }
    return words[result.rung]


def described(log: Log, plant: Plant) -> str:
    """A log's stretch, sampling time, measured parameters, and amplitudes of its inputs."""
    amplitudes = [
        f"{split(name)[0]} ±{quantity(factor * amplitude, unit_of(name), digits=3)}"
        for (name, factor), amplitude in zip(
            displayed(plant)[0], log.excitation.amplitudes, strict=True
        )
    ]
    measured = [valued(plant.label(n), float(v.mean())) for n, v in log.measured.items()]
    stretch = f"{log.t0:.2f} to {log.t0 + log.duration:.2f} s"
    return ", ".join([stretch, every(log.recorded_Ts), *measured, *amplitudes])


def explained(reason: str, checks: tuple[Check, ...]) -> str:
    """A reason with the values of the checks that failed, where they say how much."""
    failed = [check for check in checks if check.message == reason and not check.passed]
    values = "; ".join(
        f"{c.name.replace('_', ' ')} {c.value:.3g}, at most {c.limit:.3g}"
        for c in failed
        if math.isfinite(c.value) and c.limit > 0
    )
    return f"{reason} ({values})" if values else reason


def between(interval: Interval, unit: str) -> str:
    """A value with its unit and interval, to the digits that the interval is worth."""
    if not math.isfinite(interval.value):
        return "unknown"
    width = interval.high - interval.low
    digits = 2 if not 0 < width < math.inf else min(max(1 - math.floor(math.log10(width)), 0), 4)
    value, low, high = (f"{v:.{digits}f}" for v in (interval.value, interval.low, interval.high))
    return f"{value}{unit and f' {unit}'}, between {low} and {high} (90 %)"


def fallback_text(fallback: Mapping[str, float], units: Mapping[str, str]) -> str:
    """The gains to use in place of those that are refused."""
    if any(map(math.isnan, fallback.values())):
        return (
            "No gains are stable for every plant of the prior: narrow the prior, or ask for a "
            "slower loop."
        )
    gains = ", ".join(f"{split(n)[0]} {quantity(v, units[n])}" for n, v in fallback.items())
    return f"Stable for every plant that the tuner was made for: {gains}."


def every(Ts: float) -> str:
    """A sampling time [s]."""
    return f"every {Ts:.4g} s" if Ts >= 1 else f"every {1e3 * Ts:.4g} ms"


def quantity(value: float, unit: str, digits: int = 4) -> str:
    """A value and its unit."""
    return f"{value:.{digits}g} {unit}".rstrip() if math.isfinite(value) else "none"


def metric_name(metric: str) -> str:
    """A metric's name in words, without its unit."""
    return split(metric)[0].replace("_", " ")


def unit_of(name: str) -> str:
    """The unit in a name's brackets."""
    return split(name)[1]


def prior_of(plant: Plant, name: str) -> str:
    """A parameter's prior with its unit: ``5 to 50 s, normal``."""
    prior, unit = (
        dict(zip(plant.prior, plant.shapes, strict=True))[name],
        unit_of(plant.label(name)),
    )
    low, high = prior
    if low == high:
        return f"known, {quantity(low, unit)}"
    law = prior.words or ("drawn with the others" if plant.together else "")
    return ", ".join(filter(None, [f"{low:.4g} to {quantity(high, unit)}", law]))


def displayed(plant: Plant) -> tuple[Shown, Shown]:
    """Names of the inputs and of the outputs for people, and the factors to their units."""
    if plant.display is not None:
        input, output = plant.display
        return (input,), (output,)
    inputs, outputs = (
        tuple((name, 1.0) for name in names) for names in (plant.inputs_named, plant.outputs_named)
    )
    return inputs, outputs


def in_words(shown: Shown, otherwise: str) -> str:
    """Names of signals in a sentence: ``reflux and steam``."""
    *first, last = (word(name, otherwise) for name, _ in shown)
    return " and ".join([", ".join(first), last] if first else [last])


def amplitudes(plant: Plant, u: NDArray[np.float64]) -> list[str]:
    """Name and range of each input (N,) or (m, N) in its unit for people: ``steering, ±1 deg``."""
    inputs = zip(displayed(plant)[0], np.atleast_2d(u), strict=True)
    return [f"{split(name)[0]}, {levels(factor * row, name)}" for (name, factor), row in inputs]


def levels(u: NDArray[np.float64], name: str) -> str:
    """Range of a signal (N,) whose name holds its unit: ``±1 deg``."""
    low, high = float(u.min()), float(u.max())
    start = "±" if np.isclose(-low, high) else "" if low == high else f"{low:.3g} to "
    return start + quantity(high, split(name)[1], digits=3)


def controllers_units(plant: Plant) -> dict[str, str]:
    """Units of the gains that any controller of the plant's loop may have."""
    of_kp = ratio(*map(unit_of, plant.signals))
    of_Ki = f"{of_kp}/s" if of_kp else ""
    return {"kp": of_kp, "Ki": "" if of_kp == "s" else of_Ki} | dict.fromkeys(_TIMES, "s")


def gain_units(plant: Plant) -> dict[str, str]:
    """Units of the gains: those in their names, or of a known controller's."""
    known = controllers_units(plant)
    if controller_of(plant) in CONTROLLERS or plant.parametrisation.target is not None:
        return {name: unit_of(name) or known.get(name, "") for name in plant.gains}
    own = [
        unit for signals in plant.loops.values() for unit in (ratio(*map(unit_of, signals)), "s")
    ]
    return {n: unit_of(n) or unit for n, unit in zip_longest(plant.gains, own, fillvalue="")}


def vendors_rows(result: Result) -> list[tuple[str, str]]:
    """Gains in vendors' forms, a row each, of controllers that a plant names."""
    plant = result.plant
    forms = forms_in(result) if plant.controller else {}
    return [
        (form, ", ".join(f"{name} {value:.4g}" for name, value in gains.items()))
        for form, gains in forms.items()
    ]


def forms_in(result: Result) -> dict[str, dict[str, float]]:
    """A result's gains in every form that its controller has, by form."""
    plant, target = result.plant, result.plant.parametrisation.target
    Ts = plant.Ts if target is None else target.Ts
    return vendors_forms(controller_of(plant), result.gains, Ts)


def ratio(input: str, output: str) -> str:
    """Unit of input over output; empty where one of them is not known or both are equal."""
    if not (input and output) or input == output:
        return ""
    if output == f"{input}/s":
        return "s"
    return f"{input}/({output})" if "/" in output else f"{input}/{output}"


def forms_of(result: Result) -> Forms | None:
    """Forms of a PI controller; None where the gains are no PI's or do not exist."""
    target = result.plant.parametrisation.target
    if target is None or not all(map(math.isfinite, result.gains.values())):
        return None
    kp, Ti = result.gains.values()
    return Forms.of(kp, Ti, target)
