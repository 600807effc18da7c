"""Checks that decide whether gains are trusted.

The plant's simulator is fitted to the recording (`tuners.trust.fit`), and so is a reference model
that does not use it (`tuners.trust.black_box`).  Gains are trusted where the two agree: the input
explains nothing beyond the fitted simulator, both respond alike at the crossover, the fitted plant
is in the prior, with it the gains reach the target, and the recording holds enough information.
Nothing depends on which excitation was used or which method found the gains.  A nonlinear plant's
simulator may explain more than the linear reference model; only the reverse is held against it.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tuners.trust.black_box import BlackBox
from tuners.trust.fit import Fit, fit, most_coloured
from tuners.trust.identification import central
from yawrate_env.plant.names import check_name, split
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

_DOUBT = 3.0  # standard deviations that a finding must exceed to count
_STEP = 1e-3  # of a range: metrics may come from a simulation's samples
_WHITE = 2.0  # times white noise's power in a band: what white noise may happen to have


@dataclass(frozen=True, slots=True)
class Limits:
    """Largest values that are still trusted; those of the metrics are in `Metric`.

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
    unsolved : float
        Whether the design or the numerics failed, as 1 or 0.
    """

    implausible: float = 1.0
    misfit: float = 0.01
    response: float = 0.02
    noise: float = 0.3
    colour: float = 20.0
    outside: float = 0.1
    unsolved: float = 0.0


_INFORMATION = (
    "The recording holds too little information: excite more strongly, more quickly, or for longer."
)
_MISSED = "With the fitted plant these gains miss what the design rule reaches."

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
    "unsolved": "A number is missing or a search did not converge.",
}


@dataclass(frozen=True, slots=True)
class Check:
    """One of the checks that decide on trust.

    Attributes
    ----------
    name : str
        Short, as a table shows it.
    value, limit : float
        The value, and the largest one that passes.
    message : str
        Meaning of a failure.
    """

    name: str
    value: float
    limit: float
    message: str

    @property
    def passed(self) -> bool:
        """Whether the value is within its limit; not-a-number never is."""
        return bool(self.value <= self.limit)


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """Outcome of one check for B recordings: values (B,), their limit, and a message."""

    values: Array
    limit: float
    message: str


@dataclass(frozen=True, slots=True, eq=False)
class Assessment:
    """Checks of the gains for B recordings.

    Attributes
    ----------
    model : BlackBox
        The reference model.
    fit : Fit
        The fitted plant.
    metrics, spread : NDArray
        (B, f) metrics of the gains with the fitted plant, and their standard deviations.
    findings : dict
        By name of the check.
    """

    model: BlackBox
    fit: Fit
    metrics: Array
    spread: Array
    findings: dict[str, Finding]

    @property
    def trusted(self) -> NDArray[np.bool_]:
        """Where every finding is within its limit, (B,)."""
        within = [finding.values <= finding.limit for finding in self.findings.values()]
        return np.asarray(np.all(within, axis=0))

    def checks(self, index: int) -> tuple[Check, ...]:
        """The checks of one recording."""
        return tuple(
            Check(name, float(finding.values[index]), finding.limit, finding.message)
            for name, finding in self.findings.items()
        )

    def followed_by(self, findings: dict[str, Finding]) -> "Assessment":
        """The same with further checks."""
        return replace(self, findings=self.findings | findings)


def assess(
    plant: Plant,
    model: BlackBox,
    measured: Array,
    gains: Array,
    start: Array,
    solved: NDArray[np.bool_],
    anywhere: bool = False,
) -> Assessment:
    """Check gains against the recordings they come from.

    Parameters
    ----------
    model : BlackBox
        Fitted to the recordings.
    measured : (B, N) float64
        Outputs as recorded.
    gains : (B, k) float64
    start : (B, p) float64
        Where the search for the plant starts, with the measured parameters of the recordings.
    solved : (B,) bool
        Whether the numerics that found the gains succeeded.
    anywhere : bool
        Whether measured parameters may lie outside the prior, within the search limits.
    """
    with np.errstate(all="ignore"):
        found = fit(plant, model, measured, start)
        sides = np.tile(gains, (2 * max(len(plant.unknown), 1), 1))
        metrics = plant.metric_values(found.theta, gains)
        error = np.abs(metrics - plant.targets(found.theta))
        J = central(plant, found.theta, lambda t: plant.metric_values(t, sides[: len(t)]), _STEP)
        spread = np.sqrt(np.einsum("bij,bjk,bik->bi", J, found.covariance, J))
        solved = solved & found.converged & np.isfinite(gains).all(axis=1)
        findings = {
            **_of_measured(plant, start, anywhere),
            "implausible": _finding("implausible", _implausible(plant, model.u, measured)),
            **_of_metrics(plant, "spread", spread, _INFORMATION),
            **_of_recordings(plant, model, found),
            **_of_metrics(plant, "error", error, _MISSED),
            "unsolved": _finding("unsolved", np.where(solved, 0.0, 1.0)),
        }
    worded = {n: replace(f, message=plant.messages.get(n, f.message)) for n, f in findings.items()}
    return Assessment(model, found, metrics, spread, worded)


def _of_measured(plant: Plant, theta: Array, anywhere: bool) -> dict[str, Finding]:
    """How far measured parameters lie outside the range that the tuner was made for."""
    low, high = plant.limits if anywhere else plant.ranges
    found = {}
    for i, name in enumerate(plant.prior):
        if name in plant.measured:
            beyond = np.maximum(np.maximum(low[i] - theta[:, i], theta[:, i] - high[i]), 0.0)
            label = split(plant.label(name))[0]
            message = f"{label} is outside the range that the tuner was made for: " + (
                f"{low[i]:g} to {high[i]:g}."
            )
            found[label] = Finding(beyond, plant.measured[name], message)
    return found


def _of_metrics(plant: Plant, what: str, values: Array, message: str) -> dict[str, Finding]:
    """A finding for each counted metric."""
    names = (check_name(name, what) for name in plant.counted)
    parts = zip(names, values.T, plant.metric_setting(what), strict=True)
    return {name: Finding(v, float(limit), message) for name, v, limit in parts}


def _of_recordings(plant: Plant, model: BlackBox, found: Fit) -> dict[str, Finding]:
    """Findings on the residuals of the fitted plant and its difference from the black box."""
    residual, simulated = found.residual, found.simulated
    values = {
        "misfit": _misfit(plant, model, found),
        "noise": np.sqrt((residual**2).mean(axis=1) / simulated.var(axis=1)),
        "outside": _outside(plant, found),
    }
    findings = {name: _finding(name, value) for name, value in values.items()}
    if plant.crossover is not None:
        colour = found.noise / (residual**2).mean(axis=1) / model.oversampled
        most = most_coloured(residual.shape[1], model.Ts, plant.crossover)
        findings["colour"] = _finding("colour", colour, max(most / 2, _WHITE))
        if plant.linear:
            findings["response"] = _finding("response", _response(plant.crossover, model, found))
    return {name: findings[name] for name in MESSAGES if name in findings}


def _finding(name: str, values: Array, at_most: float = np.inf) -> Finding:
    return Finding(values, min(getattr(Limits(), name), at_most), MESSAGES[name])


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
    return np.asarray(np.sqrt(np.maximum(excess - chance, 0) / (found.simulated**2).sum(axis=1)))


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
