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
from tuners.trust.findings import MISS, Findings, implausible
from tuners.trust.fit import Fit
from tuners.trust.identification import central
from tuners.trust.intervals import GAUSSIAN
from tuners.trust.response import Response
from tuners.trust.verdict import Check, Finding, Verdict
from yawrate_env.plant.names import check_name
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Answer = tuple[Array, Array, dict[str, Finding]]

_DOUBT = 3.0  # standard deviations that a difference must exceed to count
_STEP = 1e-3  # of a range: metrics may come from a simulation's samples
_FOREIGN = (120.0, 0.9)  # deg, of the crossover: a reversed sign, other units, no such plant
_SMALL = 0.8  # of a miss: where one of two answers is right, the other is no miss either
_LEAST_GIVEN_UP, _MOST_GIVEN_UP = 1e-3, 0.5  # of the wanted phase margin
_INFORMATION = (
    "The recording holds too little information: excite more strongly, more quickly, or for longer."
)
_UNCERTAIN = (
    "Noise or a disturbance leaves the metrics uncertain: excite more strongly, more quickly, or "
    "for longer, or record while less disturbs the output."
)
_MISSED = "As far as the recording tells, these gains miss what the design rule reaches."
_CONTRAST = "The recording's own response asks for other gains than the fitted plant."


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
    contrast : NDArray
        (B, f) metrics by which the gains of the fitted plant and of the black box differ.
    """

    values: Array
    solved: Flags
    limited: Flags
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
    make = Findings(plant, None if response is None else np.inf)
    with np.errstate(all="ignore"):
        exact, exact_spread = predicted(plant, fitted, judged.values)
        findings = {
            **make.of_measured(start, anywhere),
            "implausible": make.of("implausible", implausible(plant, model.u, measured)),
        }
        if response is None:
            metrics, spread, found = _by_fit(make, fitted, judged, exact, exact_spread)
        else:
            metrics, spread, found = _by_response(make, response, judged)
        findings |= make.of_recordings(model, fitted, response, spread) | found
    if alone:
        exact, exact_spread = np.full_like(exact, np.nan), np.full_like(exact, np.nan)
        fitted = replace(  # a plant that nobody asked about has no parameters to report
            fitted,
            theta=np.full_like(fitted.theta, np.nan),
            covariance=np.full_like(fitted.covariance, np.nan),
        )
        asked = {"implausible", "noise", "colour", "bend", "halves", "lingering"}
        asked |= {"limited", "unsolved"}
        asked |= {check_name(m, what) for m in plant.counted for what in ("spread", "error")}
        findings = {name: finding for name, finding in findings.items() if name in asked}
    worded = {n: replace(f, message=plant.messages.get(n, f.message)) for n, f in findings.items()}
    return Assessment(model, fitted, response, metrics, spread, exact, exact_spread, worded)


def _by_response(make: Findings, response: Response, judged: Judged) -> Answer:
    """Metrics, spread and findings of gains judged with the recording's own response."""
    plant, gains = make.plant, judged.values
    error, widths, widest = _settings(plant)
    metrics, spread = response.metrics(gains), response.spread(gains)
    # Gains of the design rule miss, too, where a resonance lets the loop cross 1 once more.
    aim = np.where(response.within_reach[:, None], response.aim, response.reached)
    off = np.maximum(np.abs(metrics - aim) - _DOUBT * spread, 0.0)
    off = np.where(metrics[:, :1] > 0, off, np.inf)
    contrast = np.where(np.isnan(judged.contrast), np.inf, judged.contrast)
    foreign = np.array([_FOREIGN[0], _FOREIGN[1] * response.target.crossover])
    solved = judged.solved & np.isfinite(gains).all(axis=1)
    given_up = 1 - response.reached[:, 0] / response.target.phase_margin
    limited = np.where(judged.limited, np.maximum(given_up, _LEAST_GIVEN_UP), 0.0)
    # Known well enough to say that no controller reaches the target: nothing else is wrong.
    barred = ~np.isfinite(gains).all(axis=1) & response.without_gains
    solved |= barred
    spread, contrast, off = (np.where(barred[:, None], 0.0, a) for a in (spread, contrast, off))
    contradicted = (contrast > _SMALL * MISS * error).any(axis=1)
    vague = np.where(contradicted, (spread / widths).max(axis=1), 0.0)
    disturbed = np.where(contradicted, make.colour(response, spread), 0.0)
    return metrics, spread, {
        "undesigned": make.of("undesigned", np.where(barred, 1.0, 0.0)),
        **make.of_metrics("spread", spread, widths, widest, _INFORMATION),
        **make.of_metrics("contrast", contrast, _SMALL * MISS * error, foreign, _CONTRAST),
        "vague": make.of("vague", vague),
        "disturbed": make.of("disturbed", disturbed),
        **make.of_response(response, gains),
        **make.of_metrics("error", off, error, error, _MISSED),
        "limited": make.of("limited", limited, refusal=_MOST_GIVEN_UP),
        "unsolved": make.of("unsolved", np.where(solved, 0.0, 1.0)),
    }  # fmt: skip


def _by_fit(make: Findings, fitted: Fit, judged: Judged, metrics: Array, known: Array) -> Answer:
    """Metrics, spread and findings of gains judged with the fitted plant.

    Its metrics and their standard deviations (B, f), in white noise, are known already.
    """
    plant, gains = make.plant, judged.values
    error, widths, widest = _settings(plant)
    parts, spread, moved = np.zeros_like(known), known, None
    if fitted.discrepancy is not None:
        slopes = metric_slopes(plant, fitted, gains)
        known, parts = fitted.discrepancy.spread(slopes), fitted.discrepancy.difference(slopes)
        spread = np.maximum(known, parts)
        if fitted.sticking is not None:
            moved = np.abs(fitted.sticking @ slopes.swapaxes(1, 2)).max(axis=1)
    off = np.abs(metrics - plant.targets(fitted.theta))
    solved = judged.solved & np.isfinite(gains).all(axis=1)
    designed = np.asarray(np.isfinite(plant.oracle(fitted.theta)).all(axis=1))
    solved = (solved & ~judged.limited) | (~designed & fitted.converged)
    seen = (np.where(designed[:, None], each, 0.0) for each in (known, parts, spread, off))
    known, parts, widened, off = seen
    share = np.where(parts > 0, widened, 0.0) / widest
    stuck = {} if moved is None else make.of_sticking(np.where(designed[:, None], moved, 0.0))
    return metrics, spread, {
        "parts": make.of("parts", share.max(axis=1), refusal=1.0),
        **stuck,
        "undesigned": make.of("undesigned", np.where(designed, 0.0, 1.0)),
        **make.of_metrics("spread", known, widths, widest, _UNCERTAIN),
        **make.of_metrics("error", off, error, error, _MISSED),
        "unsolved": make.of("unsolved", np.where(solved, 0.0, 1.0)),
    }  # fmt: skip


def _settings(plant: Plant) -> tuple[Array, Array, Array]:
    """Errors and spreads (f,) that need no care, and the widest spread that is not refused."""
    error, widths = plant.metric_setting("error"), plant.metric_setting("spread")
    return error, widths, np.maximum(plant.metric_setting("widest") / GAUSSIAN, widths)


def predicted(plant: Plant, fitted: Fit, gains: Array) -> tuple[Array, Array]:
    """Metrics (B, f) of gains (B, k) with fitted plants, and their standard deviations."""
    J = metric_slopes(plant, fitted, gains)
    spread = np.sqrt(np.einsum("bij,bjk,bik->bi", J, fitted.covariance, J))
    return plant.metric_values(fitted.theta, gains), spread


def metric_slopes(plant: Plant, fitted: Fit, gains: Array) -> Array:
    """Derivatives (B, f, q) of the metrics of gains (B, k) to the parameters of fitted plants."""
    sides = np.tile(gains, (2 * max(len(plant.unknown), 1), 1))
    return central(plant, fitted.theta, lambda t: plant.metric_values(t, sides[: len(t)]), _STEP)
