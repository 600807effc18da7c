"""Hold a further recording against the answer from several."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tuners.trust.checks import metric_slopes
from tuners.trust.intervals import Interval
from tuners.tuner.ladder import FINE
from tuners.tuner.look import Look
from tuners.tuner.method import Rung
from tuners.tuner.pooling.agreement import CHANCE
from tuners.tuner.pooling.coordinates import carried
from tuners.tuner.pooling.joint import fitted_like
from tuners.tuner.pooling.pool import Pool
from tuners.tuner.pooling.pooling import Pooling, responses_of
from tuners.tuner.pooling.remarks import causes, measured, parameters
from tuners.tuner.pooling.share import Share, Validation
from tuners.tuner.result import Result

Array = NDArray[np.float64]


def validation(
    pooling: Pooling,
    looks: Sequence[Look],
    other: Look,
    pool: Pool,
    result: Result,
    factors: Sequence[float],
) -> Validation:
    """Hold a further recording against an answer.

    Parameters
    ----------
    factors : (f,) of float
        Half widths of the metrics' intervals in standard deviations.
    """
    from scipy.stats import chi2

    plant, joint = pooling.plant, pool.joint
    alone = pooling.alone
    fit = fitted_like(plant, joint, other.model, other.fit, other.used.y)
    every, fits = [*looks, other], (*joint.fits, fit)
    gains = np.array(list(result.gains.values()))[None]
    estimates = pooling.estimates(every, fits)
    among = np.arange(len(every))[:, None] < len(looks)  # all that the answer rests on
    distance = float(estimates.distances(among)[-1, 0])
    chance = float(chi2.sf(distance, estimates.freedom))
    seen = pooling.coordinates(every, fits, joint.at(plant, pool.theta))
    fitted, responses = joint.at(plant, pool.theta), responses_of(every)
    shift = pooling.shifted(len(looks), among, estimates, seen, fitted, responses, gains)
    if seen is not None:
        own = carried(responses[-1], seen, len(looks))
        values, spread = own.metrics(gains)[0], own.spread(gains)[0]
    else:
        J = metric_slopes(plant, fitted, gains)
        spread = np.sqrt(np.einsum("bij,bjk,bik->bi", J, other.fit.covariance, J))[0]
        values = plant.metric_values(fitted.theta, gains)[0] + shift[0]
    half = np.array(factors) * spread
    intervals = {
        name: Interval(float(v), float(v - h), float(v + h))
        for name, v, h in zip(plant.counted, values, half, strict=True)
    }
    gaps = np.array([_gap(each, result.intervals[name]) for name, each in intervals.items()])
    within = bool((gaps <= FINE * plant.metric_setting("error")).all())
    agrees = chance >= CHANCE
    kept = [look.fit for look in looks]
    against = Share(
        name=other.name,
        measured=measured(plant, other),
        share=0.0,
        chi_square=distance,
        freedom=estimates.freedom,
        chance=chance,
        agrees=agrees,
        shift=dict(zip(plant.counted, shift[0].tolist(), strict=True)),
        parameters={} if alone else parameters(plant, other),
        causes=() if agrees or alone else causes(plant, other, kept),
    )
    error = fit.residual if result.rung < Rung.BLACK_BOX else _left_by_black_boxes(looks, other)
    moving = other.used.y - other.used.y.mean(axis=-1, keepdims=True)
    whole = float(np.linalg.norm(plant.stacked(moving)[0]))
    left = float(np.linalg.norm(error[0])), float(np.sqrt(max(other.model.residual[0], 0.0)))
    reproduced, attainable = (100 * (1 - each / whole) if whole > 0 else np.nan for each in left)
    off = np.abs(shift[0]) > plant.metric_setting("error")
    matters = bool((off | ~np.isfinite(shift[0])).any())
    return Validation(float(reproduced), float(attainable), intervals, within, matters, against)


def _gap(one: Interval, other: Interval) -> float:
    """Distance between two intervals; negative where they overlap."""
    return max(one.low - other.high, other.low - one.high)


def _left_by_black_boxes(looks: Sequence[Look], other: Look) -> Array:
    """What the pooled black boxes of recordings leave over of another's output, (B, N)."""
    model = other.model
    scale = [
        1 / np.where(look.model.residual > 0, look.model.residual / look.used.y.shape[1], 1.0)
        for look in looks
    ]
    pairs = list(zip(looks, scale, strict=True))
    information = np.sum([look.model.information * s[:, None, None] for look, s in pairs], axis=0)
    right = np.sum(
        [
            (look.model.information @ look.model.coefficients[..., None])[..., 0] * s[:, None]
            for look, s in pairs
        ],
        axis=0,
    )
    coefficients = np.linalg.solve(information, right[..., None])[..., 0]
    simulated = model.functions.outputs(model.u, coefficients[:, None], model.Ts)[:, 0]
    return model.projected((model.y - simulated)[:, None])[:, 0]
