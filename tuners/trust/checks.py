"""Checks that decide whether gains are usable, usable with care, or refused.

The plant's simulator is fitted to the recording (`tuners.trust.fit`), and so is a black box that
does not use it (`tuners.trust.black_box`).  Where the black box has a response at the crossover
(`tuners.trust.response`), gains are judged with it, in units of the metrics, and the simulator is
the second opinion: where it contradicts by more than small errors of its data explain, gains are
usable with care at most.  For any other plant the fitted simulator judges, and what contradicts it
refuses.  Nothing depends on which excitation was used or which method found the gains.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tuners.trust.black_box import BlackBox
from tuners.trust.fit import Fit, most_coloured
from tuners.trust.identification import central
from tuners.trust.intervals import GAUSSIAN
from tuners.trust.residuals import against_declared
from tuners.trust.response import Response
from tuners.trust.verdict import Check, Finding, Verdict
from yawrate_env.plant.names import check_name, split
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_DOUBT = 3.0  # standard deviations that a finding must exceed to count
_STEP = 1e-3  # of a range: metrics may come from a simulation's samples
_WHITE = 2.0  # times white noise's power in a band: what white noise may happen to have
_MISS = 2.0  # times a metric's `error`
_SMALL = 0.8  # of a miss: where one of two answers is right, the other is no miss either


@dataclass(frozen=True, slots=True)
class Limits:
    """Largest values that pass; those of the metrics are in `Metric`.

    Attributes
    ----------
    implausible : float
        Largest input or output over what a recording of the plant can hold.
    misfit : float
        Output that the input explains and the fitted plant does not, over the output,
        beyond what noise can do.
    response : float
        Relative difference of fitted plant and black box at the crossover, beyond what
        noise can do; 0.02 is about a degree.
    noise : float
        Residual over simulated output, root mean squares.
    colour : float
        Power of the residual around the crossover over that of white noise; half of all its
        power there if that is less.
    outside : float
        Distance of the fitted plant from the prior in widths of its ranges, beyond what
        noise can do.
    bend : float
        Share by which the response grows or shrinks with the amplitude, beyond what noise can do.
    halves : float
        Metrics by which the recording's halves differ from the whole, beyond what noise can do,
        over their `error`.
    parts : float
        Standard deviation of a metric, over the widest that is not refused, where parts of the
        recording ask for other gains than the whole.
    louder : float
        Residual over the noise that the plant declares, root mean squares.
    pattern : float
        Residual over simulated output, root mean squares, where it is coloured and larger than
        the noise that the plant declares.
    limited : float
        Whether the target is out of the controller's reach, as 1 or 0.
    undesigned : float
        Whether the design rule has no gains for the fitted plant, as 1 or 0.
    unsolved : float
        Whether there are no gains or the numerics failed, as 1 or 0.
    """

    implausible: float = 1.0
    misfit: float = 0.01
    response: float = 0.02
    noise: float = 0.3
    colour: float = 20.0
    outside: float = 0.1
    bend: float = 0.03
    halves: float = 1.0
    parts: float = 1 / 3
    louder: float = 2.0
    pattern: float = 0.01
    limited: float = 0.0
    undesigned: float = 0.0
    unsolved: float = 0.0


_NOISIEST = 0.6  # residual over output beyond which gains are refused
_CONTRADICTED = 0.06  # of the output: a misfit that small errors of the simulator do not explain
_PATTERN = 0.08  # of the output: a pattern that the intervals of a nonlinear plant may not cover
_BENT = 0.1  # share of the slope beyond which gains are refused: a tenth of the crossover
_CHANGED = 4.0  # standard deviations of a difference between halves, or of a bend, that count
_INFORMATION = (
    "The recording holds too little information: excite more strongly, more quickly, or for longer."
)
_UNCERTAIN = (
    "Noise or a disturbance leaves the metrics uncertain: excite more strongly, more quickly, or "
    "for longer, or record while less disturbs the output."
)
_MISSED = "As far as the recording tells, these gains miss what the design rule reaches."
_CONTRAST = "The recording's own response asks for other gains than the fitted plant."

MESSAGES = {
    "implausible": "The input or the output is larger than it can be: check the units.",
    "misfit": "No plant in the prior reproduces this recording: check units, signs, sampling "
    "time, delays between the channels and the initial state.",
    "response": "At the crossover the recording's response differs from the fitted plant's: check "
    "the sampling time and the measured parameters.",
    "noise": "The output hardly follows the input: the sensor is dead, noisy or not the plant's.",
    "colour": "Something other than the input moves the output around the crossover: a "
    "disturbance, a drift or a sensor fault.",
    "outside": "The fitted plant lies outside the prior that the tuner was made for.",
    "bend": "The output does not grow in proportion to the input: the plant or the sensor "
    "saturates or bends. Excite with the amplitude that the loop will have.",
    "halves": "The response changes during the recording: the operating point moves, or "
    "something breaks. Record while all stays as it is.",
    "parts": "Parts of the recording ask for other gains than the whole: the plant is not as "
    "simulated, drifts or is disturbed.",
    "louder": "The residual is larger than the noise that the plant declares: the sensor is "
    "noisier, or the plant is not as simulated.",
    "pattern": "The residual is not noise but has a pattern: the plant is not as simulated, drifts "
    "or is disturbed. Compare the fitted plant with the recording.",
    "limited": "The controller cannot reach the target with this plant: the gains come as near as "
    "it can.",
    "undesigned": "The design rule has no gains for the plant that fits the recording.",
    "unsolved": "A number is missing or a search did not converge.",
}


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """Gains of B recordings, and where they come from.

    Attributes
    ----------
    values : NDArray
        (B, k) gains.
    solved : NDArray
        (B,) whether the numerics behind them succeeded.
    limited : NDArray
        (B,) whether they only come near the target.
    fitted : NDArray
        (B,) whether they rest on the fitted plant, and not on the recording alone.
    contrast : NDArray
        (B, f) metrics by which the gains of the fitted plant and of the black box differ.
    """

    values: Array
    solved: Flags
    limited: Flags
    fitted: Flags
    contrast: Array


@dataclass(frozen=True, slots=True, eq=False)
class Assessment:
    """Checks of the gains for B recordings.

    Attributes
    ----------
    model : BlackBox
        The black box.
    fit : Fit
        The fitted plant.
    response : Response, optional
        The black box's, where it judges the gains.
    metrics, spread : NDArray
        (B, f) metrics of the gains as the recording tells, and their standard deviations.
    exact_metrics, exact_spread : NDArray
        (B, f) the same with the fitted plant, as if all but its parameters were exact.
    findings : dict
        By name of the check.
    """

    model: BlackBox
    fit: Fit
    response: Response | None
    metrics: Array
    spread: Array
    exact_metrics: Array
    exact_spread: Array
    findings: dict[str, Finding]

    @property
    def verdicts(self) -> NDArray[np.int64]:
        """(B,) 0 where gains are usable, 1 with care, 2 where they are refused."""
        within = [np.where(f.values <= f.refusal, 1, 2) for f in self.findings.values()]
        passed = [f.values <= f.limit for f in self.findings.values()]
        return np.asarray(np.max(np.where(passed, 0, within), axis=0))

    @property
    def trusted(self) -> Flags:
        """Where gains are usable, with care or without, (B,)."""
        return np.asarray(self.verdicts < len(Verdict) - 1)

    def checks(self, index: int) -> tuple[Check, ...]:
        """The checks of one recording."""
        return tuple(f.check(name, index) for name, f in self.findings.items())

    def followed_by(self, findings: dict[str, Finding]) -> "Assessment":
        """The same with further checks."""
        return replace(self, findings=self.findings | findings)


def assess(
    plant: Plant,
    model: BlackBox,
    fitted: Fit,
    response: Response | None,
    measured: Array,
    judged: Judged,
    start: Array,
    *,
    anywhere: bool = False,
    alone: bool = False,
) -> Assessment:
    """Check gains against the recordings they come from.

    Parameters
    ----------
    model, fitted, response
        Black box, fitted plant, and the black box's response if the plant's metrics are its.
    measured : (B, N) float64
        Outputs as recorded.
    judged : Judged
        The gains.
    start : (B, p) float64
        Measured parameters of the recordings, in place of the others the middle of the prior.
    anywhere : bool
        Whether measured parameters may lie outside the prior, within the search limits.
    alone : bool
        Whether only the recording is asked, and not what the plant's simulator makes of it.
    """
    gains = judged.values
    with np.errstate(all="ignore"):
        exact, exact_spread = predicted(plant, fitted, gains)
        metrics, spread, aim = exact, exact_spread, plant.targets(fitted.theta)
        known, parts = spread, np.zeros_like(spread)
        if fitted.discrepancy is not None:
            slopes = metric_slopes(plant, fitted, gains)
            known, parts = fitted.discrepancy.spread(slopes), fitted.discrepancy.difference(slopes)
            spread = np.hypot(known, parts)
        if response is not None:
            metrics, spread = response.metrics(gains), response.spread(gains)
            aim = response.reached
        off = np.abs(metrics - aim)
        solved = judged.solved & np.isfinite(gains).all(axis=1)
        designed = np.asarray(np.isfinite(plant.oracle(fitted.theta)).all(axis=1))
        second = np.inf if response is not None else None
        checks = _Checks(plant, second)
        error, widths = plant.metric_setting("error"), plant.metric_setting("spread")
        widest = plant.metric_setting("widest") / GAUSSIAN
        findings = {
            **checks.of_measured(start, anywhere),
            "implausible": checks.of("implausible", _implausible(plant, model.u, measured)),
        }
        if response is None:
            known, parts, spread, off = (
                np.where(designed[:, None], each, 0.0) for each in (known, parts, spread, off)
            )
            share = np.where(parts > 0, spread, 0.0) / np.maximum(widest, widths)
            findings["parts"] = checks.of("parts", share.max(axis=1), refusal=1.0)
            findings["undesigned"] = checks.of("undesigned", np.where(designed, 0.0, 1.0))
            solved = (solved & ~judged.limited) | (~designed & fitted.converged)
        else:
            known = spread
        why = _UNCERTAIN if response is None else _INFORMATION
        findings |= {
            **checks.of_metrics("spread", known, widths, np.maximum(widest, widths), why),
            **checks.of_recordings(model, fitted, response),
        }
        if response is not None:
            most = _SMALL * _MISS * error
            contrast = np.where(np.isnan(judged.contrast), np.inf, judged.contrast)
            everything = np.full_like(most, np.inf)
            findings |= checks.of_metrics("contrast", contrast, most, everything, _CONTRAST)
            off = np.maximum(off - _DOUBT * spread, 0.0)
            findings |= checks.of_response(response, gains)
        refused = _MISS * error if response is not None else error
        findings |= checks.of_metrics("error", off, error, refused, _MISSED)
        if response is not None:
            limited = np.where(judged.limited, 1.0, 0.0)
            findings["limited"] = checks.of("limited", limited, refusal=1.0)
        findings["unsolved"] = checks.of("unsolved", np.where(solved, 0.0, 1.0))
    if alone:
        exact, exact_spread = np.full_like(exact, np.nan), np.full_like(exact, np.nan)
        asked = {"implausible", "noise", "colour", "bend", "halves", "limited", "unsolved"}
        asked |= {check_name(m, what) for m in plant.counted for what in ("spread", "error")}
        findings = {name: finding for name, finding in findings.items() if name in asked}
    worded = {n: replace(f, message=plant.messages.get(n, f.message)) for n, f in findings.items()}
    return Assessment(model, fitted, response, metrics, spread, exact, exact_spread, worded)


def predicted(plant: Plant, fitted: Fit, gains: Array) -> tuple[Array, Array]:
    """Metrics (B, f) of gains (B, k) with fitted plants, and their standard deviations."""
    J = metric_slopes(plant, fitted, gains)
    spread = np.sqrt(np.einsum("bij,bjk,bik->bi", J, fitted.covariance, J))
    return plant.metric_values(fitted.theta, gains), spread


def metric_slopes(plant: Plant, fitted: Fit, gains: Array) -> Array:
    """Derivatives (B, f, q) of the metrics of gains (B, k) to the parameters of fitted plants."""
    sides = np.tile(gains, (2 * max(len(plant.unknown), 1), 1))
    return central(plant, fitted.theta, lambda t: plant.metric_values(t, sides[: len(t)]), _STEP)


@dataclass(frozen=True, slots=True)
class _Checks:
    """Findings for one plant.

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
        sure = np.abs(response.bend) - _CHANGED * response.doubt
        values = {
            "bend": (np.where(sure > 0, np.abs(response.bend), 0.0), _BENT),
            "halves": (np.where(distance > _CHANGED, changed, 0.0), _MISS),
        }
        return {name: self.of(name, value, refusal=at) for name, (value, at) in values.items()}

    def of_recordings(
        self, model: BlackBox, found: Fit, response: Response | None
    ) -> dict[str, Finding]:
        """Findings on residuals, and on the fitted plant's difference from the black box."""
        plant = self.plant
        noise = (found.residual**2).mean(axis=1)
        left = noise if response is None else response.noise
        values = {
            "misfit": (_misfit(plant, model, found), _CONTRADICTED if response is None else np.inf),
            "noise": (np.sqrt(left / found.simulated.var(axis=1)), _NOISIEST),
            "outside": (_outside(plant, found), self.second),
        }
        findings = {n: self.of(n, value, refusal=at) for n, (value, at) in values.items()}
        if response is None:
            louder, pattern = against_declared(plant, model, found)
            findings["louder"] = self.of("louder", louder, refusal=np.inf)
            most = np.inf if plant.linear else _PATTERN
            findings["pattern"] = self.of("pattern", pattern, refusal=most)
        if plant.crossover is not None:
            colour = found.noise / noise / model.oversampled
            most = most_coloured(found.residual.shape[1], model.Ts, plant.crossover)
            findings["colour"] = self.of("colour", colour, max(most / 2, _WHITE), np.inf)
            if plant.linear and response is None:
                findings["response"] = self.of("response", _response(plant.crossover, model, found))
        return {name: findings[name] for name in MESSAGES if name in findings}


def _implausible(plant: Plant, u: Array, y: Array) -> Array:
    """Largest input or output over the plausible one, (B,)."""
    largest = zip((u, y), plant.plausible, strict=True)
    ratios = [np.abs(values).max(axis=1) / limit for values, limit in largest]
    return np.asarray(np.max(np.broadcast_arrays(*ratios), axis=0))


def _misfit(plant: Plant, model: BlackBox, found: Fit) -> Array:
    """Output that the black box explains and the fitted plant does not, beyond noise, relative."""
    freedom = max(model.functions.order - len(plant.unknown), 1)
    excess = (found.residual**2).sum(axis=1) - model.residual
    chance = found.noise * (freedom + _DOUBT * np.sqrt(2 * freedom))
    energy = found.simulated.var(axis=1) * found.simulated.shape[1]
    return np.asarray(np.sqrt(np.maximum(excess - chance, 0) / energy))


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
    free, (low, high) = plant.unknown, plant.ranges
    theta = found.theta[:, free]
    slack = _DOUBT * np.sqrt(np.einsum("bii->bi", found.covariance))
    beyond = np.maximum(low[free] - theta, theta - high[free]) / plant.width
    return np.asarray(np.maximum(beyond - slack, 0).max(axis=1, initial=0.0))
