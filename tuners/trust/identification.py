"""The gray box of any plant: parameters by Gauss-Newton, derivatives by differences.

The sum of squared output errors (for white noise and a simulator without randomness of
its own the prediction error) is minimised from the middle of the prior by damped steps
in parameters scaled by their ranges.  A parameter that is pressed against a limit stays
there.  Parameters that are measured keep their values.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yawrate_env.batch import replaced, take
from yawrate_env.plant.episodes import sample
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

STEP = 1e-4  # of a range, central
_OTHER_STARTS = 4
_MAX_STEPS = 40
_TOLERANCE = 1e-10
_ROUNDING = 1e-20  # of the output's energy: without noise the cost ends here
LARGEST_STEP = 0.5
_ROOM = 1e-9  # nearer than this to a limit is on it
_DAMPING = 1e8  # beyond it no step helps


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Where a search for B recordings' parameters ended.

    Attributes
    ----------
    theta : NDArray
        (B, p) parameters, those that are measured as given.
    cost : NDArray
        (B,) sum of squared output errors.
    converged : NDArray
        (B,) whether the last step promised nothing more.
    """

    theta: Array
    cost: Array
    converged: NDArray[np.bool_]


def identify_from_several(plant: Plant, u: Array, y: Array, start: Array | None = None) -> Found:
    """The best of `identify` from the prior's middle and from other places in it."""
    start = np.tile(plant.middle, (len(y), 1)) if start is None else start
    best = identify(plant, u, y, start)
    for place in sample(plant, _OTHER_STARTS):
        theta = start.copy()
        theta[:, plant.unknown] = place[plant.unknown]
        found = identify(plant, u, y, theta)
        rows = np.flatnonzero(found.cost < best.cost)
        best = replaced(best, rows, take(found, rows))
    return best


def identify(
    plant: Plant, u: Array, y: Array, start: Array | None = None, *, beyond: bool = False
) -> Found:
    """Find the parameters behind outputs (B, N) of inputs (N,), (1, N) or (B, N).

    Parameters
    ----------
    start : (B, p) float64, optional
        Where the search starts, if not in the middle of the prior.
    beyond : bool
        Whether it may leave the prior, to the plant's search limits.  What does so at once
        may end in a minimum that is none of the prior's.
    """
    low, high = plant.limits if beyond else plant.ranges
    u, free = np.atleast_2d(u), plant.unknown
    theta = np.tile(plant.middle, (len(y), 1)) if start is None else start.copy()
    error, energy = y - plant.respond(theta, u), (y**2).sum(axis=1)
    cost, damping = (error**2).sum(axis=1), np.full(len(y), 1e-6)
    slopes = output_slopes(plant, theta, u)
    converged = np.zeros(len(y), dtype=np.bool_)
    active = np.arange(len(y))
    for _ in range(_MAX_STEPS):
        at = theta[active][:, free]
        room = [(at - low[free]) / plant.width > _ROOM, (high[free] - at) / plant.width > _ROOM]
        step, promised = _step(slopes[active], error[active], damping[active], *room)
        done = promised <= _TOLERANCE * cost[active] + _ROUNDING * energy[active]
        converged[active[done]] = True
        keep = ~done & (damping[active] < _DAMPING)
        active, step = active[keep], step[keep]
        if not len(active):
            break
        trial = moved(plant, theta[active], step, low, high)
        output = plant.respond(trial, _rows(u, active))
        found = ((y[active] - output) ** 2).sum(axis=1)
        better = found < cost[active]  # not where the simulator gave nan
        damping[active] *= np.where(better, 0.1, 100.0)
        to = active[better]
        if len(to):
            theta[to], cost[to] = trial[better], found[better]
            error[to] = y[to] - output[better]
            slopes[to] = output_slopes(plant, theta[to], _rows(u, to))
    return Found(theta, cost, converged)


def output_slopes(plant: Plant, theta: Array, u: Array | None = None) -> Array:
    """Derivatives of outputs to the unknown parameters in their ranges' widths, (B, q, N)."""
    sides = 2 * len(plant.unknown)
    tiled = u if u is None or u.ndim == 1 or len(u) == 1 else np.tile(u, (sides, 1))
    return central(plant, theta, lambda t: plant.respond(t, tiled)).swapaxes(1, 2)


def central(
    plant: Plant, theta: Array, function: Callable[[Array], Array], step: float = STEP
) -> Array:
    """Derivatives of ``function(theta)`` (B, m) to the unknown parameters in widths, (B, m, q)."""
    (B, p), free = theta.shape, plant.unknown
    q = len(free)
    if not q:
        return np.empty((*function(theta).shape, 0))
    offsets = np.zeros((2 * q, p))
    offsets[np.arange(2 * q), np.tile(free, 2)] = step * np.concatenate([plant.width, -plant.width])
    values = function((theta + offsets[:, None]).reshape(-1, p)).reshape(2, q, B, -1)
    return np.asarray(((values[0] - values[1]) / (2 * step)).transpose(1, 2, 0))


def covariance_of(slopes: Array, sigma: Array) -> Array:
    """Inverse Fisher information of outputs' slopes (B, q, N) in noise of `sigma` (B,)."""
    return np.asarray(sigma[:, None, None] ** 2 * inverse_of(slopes))


def _rows(u: Array, index: NDArray[np.intp]) -> Array:
    return u if len(u) == 1 else u[index]


def _step(
    slopes: Array,
    error: Array,
    damping: Array,
    may_fall: NDArray[np.bool_],
    may_rise: NDArray[np.bool_],
) -> tuple[Array, Array]:
    """Damped Gauss-Newton steps (B, q), and the decrease they promise (B,)."""
    normal = slopes @ slopes.swapaxes(1, 2)
    slope = (slopes @ error[..., None])[..., 0]
    free = np.where(slope < 0, may_fall, may_rise)
    slope = np.where(free, slope, 0.0)
    eye = np.eye(slopes.shape[1])
    mask = free[:, :, None] & free[:, None, :]
    scale = np.einsum("bii->bi", normal).max(axis=1, initial=0.0)
    scale = np.where(scale > 0, scale, 1.0)[:, None, None]
    lifted = np.where(mask, normal, 0.0) * (1 + damping[:, None, None] * eye)
    lifted = lifted + (~free[:, :, None] * eye + 1e-14) * scale * eye
    step = np.linalg.solve(lifted, slope[..., None])[..., 0]
    promised = (step * slope).sum(axis=1)
    largest = np.abs(step).max(axis=1, keepdims=True, initial=0.0)
    return step * np.minimum(1.0, LARGEST_STEP / np.maximum(largest, 1e-300)), promised


def moved(plant: Plant, theta: Array, step: Array, low: Array, high: Array) -> Array:
    """Parameters after steps (B, q) in widths, each as far as the first limit that it meets."""
    free = plant.unknown
    at, change = theta[:, free], step * plant.width
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(change > 0, high[free] - at, low[free] - at) / change
    room = np.where(change == 0, 1.0, np.maximum(room, 0.0))
    fraction = room.min(axis=1, keepdims=True, initial=1.0)
    moved = theta.copy()
    moved[:, free] = np.clip(at + fraction * change, low[free], high[free])
    return moved


def inverse_of(slopes: Array) -> Array:
    """Inverse of slopes' Gram matrix (B, q, q); infinite where singular."""
    gram = slopes @ slopes.swapaxes(1, 2)
    if not gram.size:
        return np.asarray(gram)
    scale = np.sqrt(np.einsum("bii->bi", gram))
    outer = scale[:, :, None] * scale[:, None, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        normal = np.where(outer > 0, gram / outer, 0.0)
    regular = np.isfinite(normal).all(axis=(1, 2)) & (np.linalg.cond(np.nan_to_num(normal)) < 1e12)
    eye = np.eye(gram.shape[1])
    with np.errstate(divide="ignore"):
        inverse = np.linalg.inv(np.where(regular[:, None, None], normal, eye)) / outer
    return np.where(regular[:, None, None], inverse, np.where(eye > 0, np.inf, 0.0))
