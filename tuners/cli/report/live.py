"""The numbers from which a report's page recomputes the loop when somebody moves its sliders.

The page holds the response of the plant behind the answer (the fitted plant, or what the recording
shows itself) as splines over log frequency, its pulse response, and how well the recording knows
it; `templates/loop.js` applies the design rule to them.
"""

import shlex
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.cli.text import displayed, gain_units
from tuners.export import literals
from tuners.export.gains import Gains
from tuners.export.pi_program import pi_program
from tuners.logs import Log
from tuners.tuner.result import Result
from tuners.tuner.spline import slopes
from yawrate_env.loop.target import Target
from yawrate_env.loop.transfer_function import TransferFunction, open_loop

Array = NDArray[np.float64]

SLOWEST, FASTEST = 0.4, 2.5
"""Crossovers that the page offers, in the target's."""

_KNOWN = 9  # crossovers at which the recording's knowledge is computed
_DIGITS, _FEWER_DIGITS = 11, 4
_MOST_DELAY = 10  # samples beyond the target's
_MOST_NUMBERS = 40_000  # of what is left open: 0.4 MB of the page


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """The plant behind an answer, as its controller sees it.

    Attributes
    ----------
    target : Target
        Of the answer.
    omega : NDArray
        (F,) [rad/s].
    log_response : NDArray
        (F,) complex128: log magnitude, and phase [rad] without jumps; the computation delay is
        not in it.
    pulse : NDArray
        (K,) output for an input of one for one sample.
    """

    target: Target
    omega: Array
    log_response: NDArray[np.complex128]
    pulse: Array

    @classmethod
    def behind(cls, result: Result) -> "Model | None":
        """The model of a result with PI gains; None where there is nothing to move."""
        target, loop = result.plant.loop_target, result.loop
        if target is None or loop is None or loop.open is None or loop.open.pulse is None:
            return None
        if target.controller != "pi":
            return None
        omega = 2 * np.pi * loop.open.frequency
        kp, Ti = (np.array([value]) for value in result.gains.values())
        one = np.ones((1, 1))
        controller = open_loop(TransferFunction(one, one, target.Ts), kp, Ti, target)(omega)[0]
        lag = omega * target.delay_samples * target.Ts
        G = loop.open.response / controller * np.exp(1j * lag)
        phase = np.unwrap(np.angle(G))
        phase -= 2 * np.pi * (phase[0] > np.pi / 2)  # as rule R follows it from low frequency
        return cls(target, omega, np.log(np.abs(G)) + 1j * phase, loop.open.pulse)

    @property
    def range(self) -> tuple[float, float]:
        """Slowest and fastest crossover that the page offers [Hz]."""
        highest = min(FASTEST * self.target.crossover, 0.45 / self.target.Ts)
        lowest = max(SLOWEST * self.target.crossover, self.omega[0] / (2 * np.pi))
        return lowest, float(min(highest, 0.9 * self.omega[-1] / (2 * np.pi)))


def live(result: Result, log: Log, tuner: str) -> dict[str, Any] | None:
    """Everything that the page computes from, as plain JSON values; None where nothing moves."""
    model = Model.behind(result)
    if model is None:
        return None
    target, (slowest, fastest) = model.target, model.range
    kp, Ti = result.gains.values()
    of_kp, _ = gain_units(result.plant).values()
    command = ["yawrate", "tune", log.source or "LOG", "--tuner", tuner]
    return {
        "names": {"output": displayed(result.plant)[1][0][0], "gain": of_kp},
        "texts": {"command": shlex.join(command), "c": _program(result)},
        "Ts": target.Ts,
        "omega": _rounded(model.omega),
        "log_magnitude": _spline(model.omega, model.log_response.real),
        "phase": _spline(model.omega, model.log_response.imag),
        "pulse": _rounded(model.pulse),
        "start": {
            "kind": "PI",
            "crossover": target.crossover,
            "phase_margin": target.phase_margin,
            "delay": target.delay_samples,
            "kp": kp,
            "Ti": Ti,
            "intervals": _intervals(result),
        },
        "range": {"slowest": slowest, "fastest": fastest, "delay": _MOST_DELAY},
        "known": _known(result, slowest, fastest),
        "doubt": _doubt(result),
    }


def _intervals(result: Result) -> dict[str, tuple[float, float]] | None:
    """Those of phase margin and crossover; None where the recording does not tell."""
    ends = [(interval.low, interval.high) for interval in result.intervals.values()]
    if not np.isfinite(ends).all():
        return None
    return dict(zip(("phase", "crossover"), ends, strict=True))


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


def _program(result: Result) -> str | None:
    """The C program of a PI with ``@NAME@`` for its numbers; None where it cannot be written."""
    try:
        pi = Gains.of(result).pi()
    except ValueError:
        return None
    header, source, _ = pi_program(pi).values()
    text = header + source
    for name in ("gain", "step", "tracking"):
        text = text.replace(f"= {literals.number(getattr(pi, name))};", f"= @{name.upper()}@;")
    for name in ("kp", "Ti"):
        value = literals.digits(getattr(pi, name))
        text = text.replace(f"{name} = {value}", f"{name} = @{name.upper()}@")
    return text


def _rounded(values: Array, digits: int = _DIGITS) -> list[float]:
    return [float(f"{value:.{digits}g}") for value in values]
