"""Findings of the checks: what each compares, for B recordings at once."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre import Laguerre
from tuners.trust.black_box import BlackBox
from tuners.trust.feedback import controller_samples
from tuners.trust.fit import Fit, most_coloured
from tuners.trust.innovations import answers
from tuners.trust.limits import MESSAGES, Limits
from tuners.trust.residuals import against_declared, each_output
from tuners.trust.response import Response
from tuners.trust.verdict import Finding
from yawrate_env.plant.names import check_name, split
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

MISS = 2.0
"""Times a metric's `error`: what a user calls a miss."""

_DOUBT = 3.0  # standard deviations that a finding must exceed to count
_WHITE = 2.0  # times white noise's power in a band: what white noise may happen to have
_ROUNDED = 1e-3  # of a sampling time
_NOISIEST = 0.6  # residual over output beyond which gains are refused
_CONTRADICTED = 0.06  # of the output: a misfit that small errors of the simulator do not explain
_ANOTHER = 0.5  # of the output: what no other car of the same kind leaves; units are wrong
_PATTERN = 0.08  # of the output: a pattern that the intervals of a nonlinear plant may not cover
_STRONG = 0.12  # of the output: the same of a linear plant
_BENT = 0.7  # of a metric's `error`: a bend beyond which gains are refused, a third of a miss
_LINGERS = 0.04  # of the output: a start's response that lasts too long, beyond which is refused
_QUIET = 0.25  # of the spread that needs no care: noise of any colour that hides nothing
_STICKS = 0.5  # of a miss: an actuator's sticking whose size is known to about a half
_CHANGED, _CURVED = 4.0, 3.8  # standard deviations of a change between halves, and of a bend


@dataclass(frozen=True, slots=True)
class Findings:
    """Makes the findings of one plant.

    Attributes
    ----------
    second : float, optional
        Limit of refusal for checks of the fitted plant where it is the second opinion; where it
        is the only one, what fails is refused.
    """

    plant: Plant
    second: float | None

    def of(
        self, name: str, values: Array, at_most: float = np.inf, refusal: float | None = None
    ) -> Finding:
        """A finding of a check of `Limits`."""
        limit = min(getattr(Limits(), name), at_most)
        return Finding(values, limit, limit if refusal is None else refusal, MESSAGES[name])

    def of_measured(self, theta: Array, anywhere: bool) -> dict[str, Finding]:
        """How far measured parameters lie outside the range that the tuner was made for."""
        plant, found = self.plant, {}
        low, high = plant.limits if anywhere else plant.ranges
        for i, name in enumerate(plant.prior):
            if name in plant.measured:
                beyond = np.maximum(np.maximum(low[i] - theta[:, i], theta[:, i] - high[i]), 0.0)
                label = split(plant.label(name))[0]
                message = f"{label} is outside the range that the tuner was made for: " + (
                    f"{low[i]:g} to {high[i]:g}."
                )
                limit = plant.measured[name]
                refusal = limit if self.second is None else self.second
                found[label] = Finding(beyond, limit, refusal, message)
        return found

    def of_metrics(
        self, what: str, values: Array, limits: Array, refusals: Array, message: str
    ) -> dict[str, Finding]:
        """A finding for each counted metric."""
        names = (check_name(name, what) for name in self.plant.counted)
        parts = zip(names, values.T, limits, refusals, strict=True)
        return {name: Finding(v, float(a), float(b), message) for name, v, a, b in parts}

    def of_response(self, response: Response, gains: Array) -> dict[str, Finding]:
        """Findings on what the black box leaves over: it is not linear, or it changes."""
        moved, distance = response.moved(gains)
        changed = (moved / self.plant.metric_setting("error")).max(axis=1)
        bent = (response.bent(gains, _CURVED) / self.plant.metric_setting("error")).max(axis=1)
        values = {
            "bend": (bent, _BENT),
            "lingering": (response.lingering, _LINGERS),
            "halves": (np.where(distance > _CHANGED, changed, 0.0), MISS),
        }
        return {name: self.of(name, value, refusal=at) for name, (value, at) in values.items()}

    def colour(self, response: Response, spread: Array) -> Array:
        """Power (B,) of residuals around the crossover over that of white noise.

        It is 1 where metrics are so certain, (B, f), that noise of any colour hides nothing.
        """
        quiet = (spread <= _QUIET * self.plant.metric_setting("spread")).all(axis=1)
        return np.where(quiet, 1.0, response.colour)

    def of_recordings(
        self, model: BlackBox, found: Fit, response: Response | None, spread: Array
    ) -> dict[str, Finding]:
        """Findings on residuals, and on the fitted plant's difference from the black box."""
        plant = self.plant
        noise = (found.residual**2).mean(axis=1)
        left, most = (noise, _CONTRADICTED) if response is None else (response.noise, _ANOTHER)
        values = {
            "misfit": (_misfit(plant, model, found), most),
            "noise": (_noisiest(plant, found, left), _NOISIEST),
            "outside": (_outside(plant, found), self.second),
        }
        findings = {n: self.of(n, value, refusal=at) for n, (value, at) in values.items()}
        if response is None:
            louder, pattern = against_declared(plant, model, found)
            findings["louder"] = self.of("louder", louder, refusal=np.inf)
            most = _STRONG if plant.linear else _PATTERN
            findings["pattern"] = self.of("pattern", pattern, refusal=most)
        if plant.crossover is not None:
            if response is None:
                colour = found.noise / noise / model.oversampled
            else:
                colour = self.colour(response, spread)
            most = most_coloured(found.residual.shape[1], model.Ts, plant.crossover)
            findings["colour"] = self.of("colour", colour, max(most / 2, _WHITE), np.inf)
            if plant.linear and response is None:
                findings["response"] = self.of("response", _response(plant.crossover, model, found))
        return {name: findings[name] for name in MESSAGES if name in findings}

    def of_sticking(self, moved: Array) -> dict[str, Finding]:
        """Whether an actuator that sticks would have moved metrics (B, f)."""
        share = (moved / (MISS * self.plant.metric_setting("error"))).max(axis=1)
        return {"sticking": self.of("sticking", share, refusal=_STICKS)}

    def of_feedback(
        self, functions: Laguerre, u: Array, y: Array, Ts: float, reference: Array | None
    ) -> dict[str, Finding]:
        """Whether inputs answer outputs, or references do where there are some."""
        if not self.plant.linear or self.plant.channels is not None:
            return {}
        target = self.plant.loop_target
        step = 1 if target is None else max(int(target.Ts / Ts * (1 + _ROUNDED)), 1)
        own = controller_samples(u[0], step)
        asked, u, y = (u if reference is None else reference)[:, own], u[:, own], y[:, own]
        found = answers(asked, u, y, step * Ts, functions)
        if reference is not None:
            return {"reference": self.of("reference", np.abs(found).max(axis=1))}
        return {"feedback": self.of("feedback", (-_sign(self.plant) * found).max(axis=1))}


@lru_cache(maxsize=8)
def _sign(plant: Plant) -> float:
    """Of the plant's gain: how the output in mid-prior follows a step."""
    step = np.ones(len(plant.u))
    return float(np.sign(plant.emulated(step).respond(plant.middle, step)[0].mean()))


def implausible(plant: Plant, u: Array, y: Array) -> Array:
    """Largest input or output over the plausible one, (B,)."""
    largest = zip((u, y), plant.plausible, strict=True)
    ratios = [np.abs(v.reshape(len(v), -1)).max(axis=1) / limit for v, limit in largest]
    return np.asarray(np.max(np.broadcast_arrays(*ratios), axis=0))


def _misfit(plant: Plant, model: BlackBox, found: Fit) -> Array:
    """Output that the black box explains and the fitted plant does not, beyond noise, relative.

    Of several outputs the one of which that is most; each could have all the parameters to itself.
    """
    rows = model if model.rows is None else model.rows
    residual, simulated = (each_output(plant, a) for a in (found.residual, found.simulated))
    freedom = max(rows.coefficients.shape[1] + rows.kept - len(plant.unknown), 1)
    excess = (residual**2).sum(axis=1) - rows.residual
    noise = found.noise.repeat(len(residual) // len(found.noise))
    chance = noise * (freedom + _DOUBT * np.sqrt(2 * freedom))
    energy = simulated.var(axis=1) * simulated.shape[1]
    values = np.sqrt(np.maximum(excess - chance, 0) / energy)
    return np.asarray(values.reshape(len(found.residual), -1).max(axis=1))


def _noisiest(plant: Plant, found: Fit, left: Array) -> Array:
    """Residual over simulated output, root mean squares (B,), of several outputs the largest."""
    if plant.channels is None:
        return np.asarray(np.sqrt(left / found.simulated.var(axis=1)))
    residual, simulated = (each_output(plant, a) for a in (found.residual, found.simulated))
    ratio = np.sqrt((residual**2).mean(axis=1) / simulated.var(axis=1))
    return np.asarray(ratio.reshape(len(left), -1).max(axis=1))


def _response(crossover: float, model: BlackBox, found: Fit) -> Array:
    """Relative difference of black box and fitted plant, less three standard deviations.

    The black box's coefficients on what the plant leaves over are their difference.
    """
    functions = model.functions.frequency_response(np.array([2 * np.pi * crossover]), model.Ts)
    nothing = np.empty((0, model.u.shape[1]))
    _, right = model.functions.normal_equations(model.u, found.residual, model.Ts, nothing)
    difference = np.linalg.solve(model.information, right[..., None])[..., 0] @ functions
    fitted = np.abs(model.coefficients @ functions - difference)[:, 0]
    scaled = np.linalg.solve(model.information, functions)[..., 0]
    variance = (scaled @ functions.conj()).real[:, 0]
    spread = np.sqrt(found.noise * variance) / fitted
    return np.asarray(np.maximum(np.abs(difference[:, 0]) / fitted - _DOUBT * spread, 0))


def _outside(plant: Plant, found: Fit) -> Array:
    """Distance from the prior in widths of its ranges, less three standard deviations."""
    of, (low, high) = plant.lasting, plant.ranges
    free = plant.unknown[of]
    theta = found.theta[:, free]
    slack = _DOUBT * np.sqrt(np.einsum("bii->bi", found.covariance)[:, of])
    beyond = np.maximum(low[free] - theta, theta - high[free]) / plant.width[of]
    return np.asarray(np.maximum(beyond - slack, 0).max(axis=1, initial=0.0))
