"""The numbers from which a report's page recomputes the loop when somebody moves its sliders.

The page holds the response of the plant behind the answer (the fitted plant, or what the recording
shows itself) as splines over log frequency, its pulse response, how well the recording knows it,
and each controller: names of gains, form, and its law by rule R or a table of gains.
`templates/loop.js` computes from them.
"""

import shlex
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.cli.answer import bare
from tuners.cli.report.model import Model
from tuners.cli.report.programs import programs
from tuners.cli.text import controllers_units, displayed, gain_units, unit_of
from tuners.logs import Log
from tuners.tuner.result import Result
from tuners.tuner.spline import slopes
from yawrate_env.loop.controllers import CONTROLLERS, LeadLag
from yawrate_env.loop.state_feedback import STATE_FEEDBACK
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant
from yawrate_env.plant.sliders import A_HALF_FASTER, MOST_DELAY, Choice, Request

Array = NDArray[np.float64]

_KNOWN = 9  # crossovers at which the recording's knowledge is computed
_DIGITS, _FEWER_DIGITS = 11, 4
_MOST_NUMBERS = 40_000  # of what is left open: 0.4 MB of the page
_MARGINS = 30, 80  # [deg]


def live(result: Result, log: Log, tuner: str) -> dict[str, Any] | None:
    """Everything that the page computes from, as plain JSON values; None where nothing moves."""
    model = Model.behind(result)
    if model is None:
        return None
    sliders, target, plant = model.sliders, model.sliders.target, result.plant
    own = sliders.choices[0].controller
    command = ["yawrate", "tune", log.source or "LOG", "--tuner", tuner]
    slowest, fastest = model.range
    ((input, _),), ((output, _),) = displayed(plant)
    return {
        "names": {"output": output, "command": unit_of(input)},
        "texts": {
            "command": shlex.join(command) if plant.loop_target else None,
            "c": programs(result, (one.controller.name for one in sliders.choices)),
        },
        "Ts": target.Ts,
        "omega": _rounded(model.omega),
        "seen": _seen(model),
        "pulse": _rounded(model.pulse),
        "unstable": sliders.unstable,
        "integrators": sliders.integrators,
        "crossover": model.crossover,
        "kinds": {one.controller.name: _kind(one, plant, sliders.asked) for one in sliders.choices},
        "sliders": _sliders(model),
        "pace": _pace(sliders.asked, sliders.shaped),
        "start": {
            "kind": own.name,
            "crossover": target.crossover,
            "margin": target.phase_margin,
            "delay": target.delay_samples,
            "asked": 0 if sliders.asked is None else sliders.asked.start,
            "gains": bare(result.gains),
            "intervals": _intervals(result),
        },
        "known": _known(result, slowest, fastest),
        "doubt": _doubt(result),
    }


def _seen(model: Model) -> list[dict[str, Any]]:
    """The signals that the controller sees: response, and pulse response if not the output's."""
    several = model.pulses is not None
    return [
        {
            "name": f"x{i + 1}" if several else "y",
            "log_magnitude": _spline(model.omega, found.real),
            "phase": _spline(model.omega, found.imag),
            "pulse": None if model.pulses is None else _rounded(model.pulses[i]),
        }
        for i, found in enumerate(model.log_responses)
    ]


def _kind(of: Choice, plant: Plant, asked: Request | None) -> dict[str, Any]:
    """A controller: gains with their units, form, sliders, and law or table."""
    controller, own = of.controller, gain_units(plant)
    units = dict(zip((split(name)[0] for name in own), own.values(), strict=True))
    known = controllers_units(plant)
    names = [split(name)[0] for name in controller.gains]
    found: dict[str, Any] = {"gains": [[name, units.get(name) or known.get(name, "")]
                                       for name in names]}  # fmt: skip
    moved = ["asked"] if asked is not None else []
    if controller.name == STATE_FEEDBACK:
        found["states"] = names[:-1]
    else:
        form: Any = CONTROLLERS[controller.name]
        found |= {
            "integrates": form.integrates,
            "derives": form.derives,
            "c": int(getattr(form, "of_error", True)),
        }
        if of.gains is None:
            found["law"] = law = _law(form)
            moved = ["crossover", "margin"] if law.get("zeros") else ["crossover"]
        moved += ["b"] if "b" in names else []
    if of.gains is not None:
        found["table"] = [[_row(row) for row in rows] for rows in of.gains]
    return found | {"sliders": [*moved, "delay"]}


def _law(form: Any) -> dict[str, Any]:
    """A controller's form in rule R."""
    if form == LeadLag():
        return {"zeros": 1, "integrators": 0, "centred": True}
    law = form.law
    return {"zeros": law.zeros, "integrators": law.integrators, "filtered": law.filtered}


def _row(gains: Array) -> list[float | None]:
    """Gains of a table; None where there are none."""
    return [value if np.isfinite(value) else None for value in _rounded(gains)]


def _sliders(model: Model) -> list[dict[str, Any]]:
    """The sliders: name, words, unit, ends and step; how positions become values."""
    sliders, (slowest, fastest) = model.sliders, model.range
    target, asked = sliders.target, sliders.asked
    slow = target.Ts >= 1
    low, high = _MARGINS
    crossover = {"min": np.log(slowest), "max": np.log(fastest), "step": "any", "log": True}
    found = [
        {"name": "crossover", "label": "Crossover", "unit": "Hz", **crossover},
        {"name": "margin", "label": "Phase margin", "unit": "°",
         "min": min(low, target.phase_margin), "max": max(high, target.phase_margin), "step": 1},
    ] if sliders.shaped else []  # fmt: skip
    if asked is not None:
        label, unit = split(asked.label)
        found.append({"name": "asked", "label": label[0].upper() + label[1:], "unit": unit,
                      "min": 0, "max": len(asked.values) - 1, "step": 1,
                      "values": _rounded(asked.values)})  # fmt: skip
    if any("b" in one.controller.gains for one in sliders.choices):
        found.append({"name": "b", "label": "Weight b of the reference", "unit": "",
                      "min": 0, "max": 1, "step": 0.05})  # fmt: skip
    delay = {"min": 0, "max": target.delay_samples + MOST_DELAY, "step": 1,
             "factor": target.Ts * (1 if slow else 1e3)}  # fmt: skip
    found.append({"name": "delay", "label": "Computation delay", "unit": "s" if slow else "ms",
                  **delay})  # fmt: skip
    return found


def _pace(asked: Request | None, shaped: bool) -> dict[str, Any] | None:
    """Which slider makes loops 1.5 times as fast, and how far; None where no one does."""
    if shaped:
        return {"slider": "crossover", "factor": 1.5}
    if asked is None:
        return None
    return {"slider": "asked", "steps": asked.faster * A_HALF_FASTER}


def _intervals(result: Result) -> dict[str, tuple[float, float] | None]:
    """Those of the metrics, by name without unit; None where the recording does not tell."""
    found = {split(name)[0]: (one.low, one.high) for name, one in result.intervals.items()}
    return {name: ends if np.isfinite(ends).all() else None for name, ends in found.items()}


def _spline(omega: Array, values: Array) -> dict[str, list[float]]:
    """Values, and slopes over log frequency, of a cubic spline."""
    return {"value": _rounded(values), "slope": _rounded(slopes(np.log(omega), values))}


def _known(result: Result, slowest: float, fastest: float) -> dict[str, Any] | None:
    """Covariance of log magnitude and phase that a controller must supply, by crossover."""
    response = result.response
    if response is None or not np.isfinite(response.coefficients).all():
        return None
    crossovers = np.geomspace(slowest, fastest, _KNOWN)
    found = np.array([response.at(float(f)).covariance[0] for f in crossovers])
    spread = response.spread(np.array([list(result.gains.values())]))[0]
    half = [interval.high - interval.value for interval in result.intervals.values()]
    with np.errstate(divide="ignore", invalid="ignore"):
        factors = np.array(half) / spread
    if not (np.isfinite(found).all() and np.isfinite(factors).all()):
        return None
    return {
        "crossover": _rounded(crossovers),
        "magnitude": _rounded(found[:, 0, 0]),
        "both": _rounded(found[:, 0, 1]),
        "phase": _rounded(found[:, 1, 1]),
        "factors": _rounded(factors),
    }


def _doubt(result: Result) -> list[list[float]] | None:
    """What the recording leaves open of the pulse response, for 90 % bands.

    None where that is unknown, or would make the page too large.
    """
    if result.response is None:
        return None
    half = np.array([interval.high - interval.value for interval in result.intervals.values()])
    found = result.response.doubt(np.array(list(result.gains.values())), half)
    if found is None or found.size > _MOST_NUMBERS:
        return None
    return [_rounded(row, _FEWER_DIGITS) for row in found]


def _rounded(values: Array, digits: int = _DIGITS) -> list[float]:
    return [float(f"{value:.{digits}g}") for value in values]
