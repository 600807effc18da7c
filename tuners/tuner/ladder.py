"""The ladder: whose gains answer a recording, from the learner's down to the black box's.

=============  ===========================================================================
rung           answers where
=============  ===========================================================================
method's own   the fitted plant confirms its gains
fitted plant   the recording's own response does not contradict the fitted plant
black box      the recording alone has gains
none           nothing has
=============  ===========================================================================

Agreement means metrics that differ by no more than noise can do, in the metrics' units.  A plant
whose metrics are not those of a loop at a target, or that is not linear, has no black box: there
the ladder ends with the fitted plant.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tuners.trust.checks import Assessment, Judged, predicted
from tuners.trust.fit import Fit
from tuners.trust.intervals import GAUSSIAN
from tuners.trust.response import Response
from tuners.trust.suspects import explanations
from tuners.tuner.method import Gains, Rung
from yawrate_env.loop.design import Status
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_CONFIRMED = 2.0  # standard deviations of the fitted plant's metrics
_NEGLIGIBLE = 0.02  # of a metric's `error`: differences that are none
_CONTRADICTED = 16.0  # squared distance over its covariance, by chance once in 3000 recordings
_NOT_CONFIRMED = "The learner's gains differ from the fitted plant's, which the recording confirms."
_NOT_FITTED = "No plant of the prior reproduces this recording, or none of its gains suit it."

FINE = 0.04
"""Of a metric's `error`: what the truncation of a black box's functions may cost."""


@dataclass(frozen=True, slots=True, eq=False)
class Climb:
    """The answer of the ladder for B recordings.

    Attributes
    ----------
    gains : Gains
        Of the rungs that answer.
    rung : NDArray
        (B,) of `Rung`.
    contrast : NDArray
        (B, f) metrics by which the gains of fitted plant and black box differ, with the black
        box; ``nan`` where there is none.
    contradiction : NDArray
        (B,) the same as a squared distance in standard deviations.
    refined : NDArray
        (B, k) gains of the fitted plants.
    """

    gains: Gains
    rung: NDArray[np.int64]
    contrast: Array
    contradiction: Array
    refined: Array

    @property
    def judged(self) -> Judged:
        """What is to be assessed."""
        limited = self.gains.status == Status.PHASE_LIMITED
        return Judged(self.gains.values, self.gains.converged, limited, self.contrast)

    def without(self, rows: Flags) -> "Climb":
        """The same with the gains of some recordings (B,) removed."""
        if not rows.any():
            return self
        return replace(
            self, gains=self.gains.without(rows), rung=np.where(rows, Rung.NONE, self.rung)
        )


def contrast(plant: Plant, refined: Array, response: Response | None) -> tuple[Array, Array]:
    """Metrics (B, f) by which gains (B, k) differ from the black box's, and their distance (B,)."""
    if response is None:
        return np.full((len(refined), len(plant.counted)), np.nan), np.zeros(len(refined))
    with np.errstate(invalid="ignore"):
        difference = response.metrics(refined) - response.reached
        covariance = response.metric_covariance(response.gains)
        fine = np.diag((FINE * plant.metric_setting("error")) ** 2)
        covariance = np.where(np.isfinite(covariance), covariance, 0.0) + fine
        weighted = np.linalg.solve(covariance, difference[..., None])[..., 0]
        distance = (difference * weighted).sum(axis=1)
    return np.abs(difference), np.where(np.isnan(distance), np.inf, distance)


def climb(
    plant: Plant,
    rungs: tuple[Rung, ...],
    own: Gains,
    fitted: Fit,
    response: Response | None,
    known: Flags,
) -> Climb:
    """Choose the rungs that answer recordings.

    Parameters
    ----------
    rungs : tuple of Rung
        Those that may answer.
    own : Gains
        The method's.
    fitted : Fit
        Plants fitted to the recordings.
    response : Response, optional
        What the recordings say themselves.
    known : (B,) bool
        Whether the measured parameters are in the range that the tuner was made for.
    """
    refined, reached = plant.designs(fitted.theta)
    difference, distance = contrast(plant, refined, response)
    if rungs == (Rung.METHOD,):
        return Climb(own, np.full(len(known), Rung.METHOD), difference, distance, refined)
    rung = np.full(len(known), Rung.NONE)
    if Rung.FITTED_PLANT in rungs:
        supported = fitted.converged & np.isfinite(refined).all(axis=1) & known
        supported &= (distance <= _CONTRADICTED) | (response is None)
        confirmed = _confirmed(plant, fitted, own, refined)
        confirmed &= Rung.METHOD in rungs
        rung = np.where(supported, np.where(confirmed, Rung.METHOD, Rung.FITTED_PLANT), rung)
    chosen = Gains.of(refined, reached, fitted.converged).replaced(rung == Rung.METHOD, own)
    if response is None:
        rung = np.where(rung == Rung.NONE, Rung.FITTED_PLANT, rung)
        return Climb(chosen, rung, difference, distance, refined)
    alone = Gains.of(response.gains, response.within_reach, np.ones(len(rung), dtype=np.bool_))
    chosen = chosen.replaced(rung == Rung.NONE, alone)
    found = np.isfinite(chosen.values).all(axis=1)
    rung = np.where((rung == Rung.NONE) & found, Rung.BLACK_BOX, rung)
    return Climb(chosen, rung, difference, distance, refined)


def _confirmed(plant: Plant, fitted: Fit, own: Gains, refined: Array) -> Flags:
    """Where fitted plants confirm gains: as good as the design rule's, as far as noise tells."""
    with np.errstate(all="ignore"):
        metrics, spread = predicted(plant, fitted, own.values)
        rule = plant.metric_values(fitted.theta, refined)
        aim = rule if plant.target is None else np.array(plant.target)
        allowed = _CONFIRMED * spread + _NEGLIGIBLE * plant.metric_setting("error")
        near = np.abs(metrics - aim) <= np.abs(rule - aim) + allowed
        return np.asarray(near.all(axis=1) & own.converged)


def left(
    rungs: tuple[Rung, ...], plant: Plant, climbed: Climb, found: Assessment, i: int
) -> tuple[str, ...]:
    """Why recording `i` is not answered by a higher rung, in words."""
    rung, response = climbed.rung[i], found.response
    if rung == Rung.FITTED_PLANT and response is not None:
        return (_NOT_CONFIRMED,) if Rung.METHOD in rungs else ()
    if rung < Rung.BLACK_BOX or response is None or response.without_gains[i]:
        return ()
    if (GAUSSIAN * found.spread[i] > plant.metric_setting("widest")).any():
        return ()  # so little is known that no difference means anything
    return explanations(plant, found.model, found.fit, i) or differs(plant, climbed, response, i)


def differs(plant: Plant, climbed: Climb, response: Response, i: int) -> tuple[str, ...]:
    """How the recording's response at the crossover differs from the fitted plant's."""
    target = response.target
    fitted = plant.parametrisation.encode(climbed.refined[[i]])[0]
    gain, phase = response.required[i] - fitted
    if not np.isfinite([gain, phase]).all():
        return (_NOT_FITTED,)
    late, share = phase / target.omega_c, np.expm1(-gain)
    words = [
        f"{abs(1e3 * late):.0f} ms {'later' if late > 0 else 'sooner'}",
        f"{abs(share):.0%} {'stronger' if share > 0 else 'weaker'}",
    ]
    return (
        f"At the crossover the output answers {words[0]} and {words[1]} than the fitted plant: is "
        "the logged input the command, and are time base, scales and the plant's data right?",
    )
