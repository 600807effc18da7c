"""The gray box of any plant: parameters by Gauss-Newton, derivatives by differences.

The sum of squared output errors (for white noise and a simulator without randomness of
its own the prediction error) is minimised from the middle of the prior by damped steps
in parameters scaled by their ranges.  A parameter that is pressed against a limit stays
there.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.plants.black_box import sample
from tuners.plants.plant import Plant
from yawrate_env.batch import replaced, take

Array = NDArray[np.float64]

STEP = 1e-4  # of a range, central
_OTHER_STARTS = 4
_MAX_STEPS = 40
_TOLERANCE = 1e-10
_ROUNDING = 1e-20  # of the output's energy: without noise the cost ends here
_LARGEST_STEP = 0.5
_ROOM = 1e-9  # nearer than this to a limit is on it
_DAMPING = 1e8  # beyond it no step helps


@dataclass(frozen=True, slots=True, eq=False)
class Identified:
    """What B recordings say of the parameters.

    Attributes
    ----------
    theta : NDArray
        (B, p) parameters found.
    covariance : NDArray
        (B, p, p) of these, for white noise; ``inf`` where the data do not determine them.
    simulated : NDArray
        (B, N) the plant's output with these parameters.
    residual : NDArray
        (B, N) measured minus simulated.
    converged : NDArray
        (B,) whether the last step promised nothing more.
    """

    theta: Array
    covariance: Array
    simulated: Array
    residual: Array
    converged: NDArray[np.bool_]


def identify_from_several(plant: Plant, u: Array, y: Array) -> Identified:
    """The best of `identify` from the prior's middle and from other places in it."""
    best = identify(plant, u, y)
    for theta in sample(plant, _OTHER_STARTS):
        found = identify(plant, u, y, np.tile(theta, (len(y), 1)))
        better = (found.residual**2).sum(axis=1) < (best.residual**2).sum(axis=1)
        rows = np.flatnonzero(better)
        best = replaced(best, rows, take(found, rows))
    return best


def identify(
    plant: Plant, u: Array, y: Array, start: Array | None = None, *, beyond: bool = False
) -> Identified:
    """Find the parameters behind outputs (B, N) of one input (N,).

    Parameters
    ----------
    start : (B, p) float64, optional
        Where the search starts, if not in the middle of the prior.
    beyond : bool
        Whether it may leave the prior, to the plant's search limits.  What does so at once
        may end in a minimum that is none of the prior's.
    """
    low, high = plant.search_limits if beyond else plant.ranges
    width = np.subtract(*plant.ranges[::-1])
    theta = np.tile(plant.middle, (len(y), 1)) if start is None else start.copy()
    simulated = plant.respond(theta, u)
    error, energy = y - simulated, (y**2).sum(axis=1)
    cost, damping = (error**2).sum(axis=1), np.full(len(y), 1e-6)
    slopes = output_slopes(plant, theta, u)
    converged = np.zeros(len(y), dtype=np.bool_)
    active = np.arange(len(y))
    for _ in range(_MAX_STEPS):
        room = [(theta[active] - low) / width > _ROOM, (high - theta[active]) / width > _ROOM]
        step, promised = _step(slopes[active], error[active], damping[active], *room)
        done = promised <= _TOLERANCE * cost[active] + _ROUNDING * energy[active]
        converged[active[done]] = True
        keep = ~done & (damping[active] < _DAMPING)
        active, step = active[keep], step[keep]
        if not len(active):
            break
        trial = _within(theta[active], step * width, low, high)
        output = plant.respond(trial, u)
        found = ((y[active] - output) ** 2).sum(axis=1)
        better = found < cost[active]  # not where the simulator gave nan
        damping[active] *= np.where(better, 0.1, 100.0)
        to = active[better]
        if len(to):
            theta[to], cost[to], simulated[to] = trial[better], found[better], output[better]
            error[to] = y[to] - output[better]
            slopes[to] = output_slopes(plant, theta[to], u)
    variance = (error**2).mean(axis=1)
    covariance = variance[:, None, None] * _inverse(slopes) * (width[:, None] * width)
    return Identified(theta, covariance, simulated, error, converged)


def output_slopes(plant: Plant, theta: Array, u: Array | None = None) -> Array:
    """Derivatives of the outputs to the parameters in their ranges' widths, (B, p, N)."""
    return central(plant, theta, lambda t: plant.respond(t, u)).swapaxes(1, 2)


def central(
    plant: Plant, theta: Array, function: Callable[[Array], Array], step: float = STEP
) -> Array:
    """Derivatives of ``function(theta)`` (B, m) to the parameters in widths, (B, m, p)."""
    B, p = theta.shape
    offsets = step * np.concatenate([np.eye(p), -np.eye(p)]) * np.subtract(*plant.ranges[::-1])
    values = function((theta + offsets[:, None]).reshape(-1, p)).reshape(2, p, B, -1)
    return np.asarray(((values[0] - values[1]) / (2 * step)).transpose(1, 2, 0))


def covariance_of(slopes: Array, sigma: Array) -> Array:
    """Inverse Fisher information of outputs' slopes (B, p, N) in noise of `sigma` (B,)."""
    return np.asarray(sigma[:, None, None] ** 2 * _inverse(slopes))


def _step(
    slopes: Array,
    error: Array,
    damping: Array,
    may_fall: NDArray[np.bool_],
    may_rise: NDArray[np.bool_],
) -> tuple[Array, Array]:
    """Damped Gauss-Newton steps (B, p), and the decrease they promise (B,)."""
    normal = slopes @ slopes.swapaxes(1, 2)
    slope = (slopes @ error[..., None])[..., 0]
    free = np.where(slope < 0, may_fall, may_rise)
    slope = np.where(free, slope, 0.0)
    eye = np.eye(slopes.shape[1])
    mask = free[:, :, None] & free[:, None, :]
    scale = np.einsum("bii->bi", normal).max(axis=1)
    scale = np.where(scale > 0, scale, 1.0)[:, None, None]
    lifted = np.where(mask, normal, 0.0) * (1 + damping[:, None, None] * eye)
    lifted = lifted + (~free[:, :, None] * eye + 1e-14) * scale * eye
    step = np.linalg.solve(lifted, slope[..., None])[..., 0]
    promised = (step * slope).sum(axis=1)
    largest = np.abs(step).max(axis=1, keepdims=True)
    return step * np.minimum(1.0, _LARGEST_STEP / np.maximum(largest, 1e-300)), promised


def _within(theta: Array, step: Array, low: Array, high: Array) -> Array:
    """Parameters after steps (B, p), each as far as the first limit that it meets."""
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(step > 0, high - theta, low - theta) / step
    fraction = np.where(step == 0, 1.0, room).min(axis=1, keepdims=True)
    return np.asarray(np.clip(theta + np.minimum(fraction, 1.0) * step, low, high))


def _inverse(slopes: Array) -> Array:
    """Inverse of slopes' Gram matrix (B, p, p); infinite where singular."""
    gram = slopes @ slopes.swapaxes(1, 2)
    scale = np.sqrt(np.einsum("bii->bi", gram))
    outer = scale[:, :, None] * scale[:, None, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        normal = np.where(outer > 0, gram / outer, 0.0)
    regular = np.isfinite(normal).all(axis=(1, 2)) & (np.linalg.cond(np.nan_to_num(normal)) < 1e12)
    eye = np.eye(gram.shape[1])
    with np.errstate(divide="ignore"):
        inverse = np.linalg.inv(np.where(regular[:, None, None], normal, eye)) / outer
    return np.where(regular[:, None, None], inverse, np.where(eye > 0, np.inf, 0.0))
