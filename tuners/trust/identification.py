"""The gray box: parameters of any plant behind recordings, by Gauss-Newton steps.

The sum of squared output errors (for white noise and a simulator without randomness of its
own the prediction error) is minimised by damped steps.  Slopes come from the plant where it
has exact ones (`yawrate_env.plant.sensitivity`), and else from central differences in
parameters scaled by their ranges.  A parameter that is pressed against a limit stays there.
Measured parameters keep their values.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yawrate_env.batch import replaced, take
from yawrate_env.plant.episodes import sample
from yawrate_env.plant.plant import Plant
from yawrate_env.plant.sensitivity import Sensitivity

Array = NDArray[np.float64]

STEP = 1e-4  # of a range, central
LARGEST_STEP = 0.5  # of a range
_OTHER_STARTS = 4
_MAX_STEPS = 40
_TOLERANCE = 1e-10
_GAINED = 1e-4  # of the cost: a last step that gained more is not the last
_ROUNDING = 1e-24  # of the output's energy: without noise the cost ends here
_ROOM = 1e-9  # of a range: nearer to a limit is on it
_DAMPING = 1e8  # beyond it no step helps
_UNSEEN_GAIN = 1e-3  # of the noise's variance: a decrease of the cost that moves nothing
_UNSEEN = 1e-13  # of the largest information: rounding

UNIFORM = 1 / 12
"""Variance of a uniform distribution of width one."""


@dataclass(frozen=True, slots=True, eq=False)
class Identified:
    """Parameters found behind B recordings.

    Attributes
    ----------
    theta : NDArray
        (B, p) parameters, measured ones as given.
    cost : NDArray
        (B,) sum of squared output errors.
    converged : NDArray
        (B,) whether the last step promised nothing more, the outputs depend on some unknown
        parameter, and no limit outside the prior stopped the search.  Parameters that the
        outputs do not depend on stay where they were.
    steps : NDArray
        (B,) evaluations of the slopes.
    """

    theta: Array
    cost: Array
    converged: NDArray[np.bool_]
    steps: NDArray[np.int64]

    @classmethod
    def none(cls, start: Array) -> "Identified":
        """Searches that never left their start (B, p)."""
        count = len(start)
        nothing = np.zeros(count, dtype=np.int64)
        return cls(start, np.full(count, np.inf), nothing.astype(np.bool_), nothing)


@dataclass(frozen=True, slots=True)
class Differences:
    """Normal equations by central differences, in parameters scaled by their ranges."""

    plant: Plant

    def encode(self, theta: Array) -> Array:
        """Parameters (B, p) to the unknown ones in widths of their ranges (B, q)."""
        return np.asarray(theta[:, self.plant.unknown] / self.plant.width)

    def decode(self, z: Array, theta: Array) -> Array:
        """Parameters (B, p) with the scaled values in place of those in `theta`."""
        found = theta.copy()
        found[:, self.plant.unknown] = z * self.plant.width
        return found

    def shortened(self, step: Array) -> Array:
        """Steps (B, q) of at most half a range in each parameter, in the same direction."""
        largest = np.abs(step).max(axis=1, keepdims=True, initial=0.0)
        return np.asarray(step * np.minimum(1.0, LARGEST_STEP / np.maximum(largest, 1e-300)))

    def gram(self, theta: Array, u: Array, y: Array, rows: NDArray[np.intp]) -> Array:
        """Inner products (R, 1 + q, 1 + q) of output error and slopes over the recordings."""
        u = u if len(u) == 1 else u[rows]
        error = y[rows] - self.plant.answers(theta, u)
        slopes = output_slopes(self.plant, theta, u)
        signals = np.concatenate([error[:, None], slopes], axis=1)
        return np.asarray(signals @ signals.swapaxes(1, 2))


def identify_from_several(
    plant: Plant, u: Array, y: Array, start: Array | None = None
) -> Identified:
    """The best of `identify` from the prior's middle and from other points of the prior."""
    start = np.tile(plant.middle, (len(y), 1)) if start is None else start
    best = identify(plant, u, y, start)
    for point in sample(plant, _OTHER_STARTS):
        theta = start.copy()
        theta[:, plant.unknown] = point[plant.unknown]
        found = identify(plant, u, y, theta)
        rows = np.flatnonzero(found.cost < best.cost)
        best = replaced(best, rows, take(found, rows))
    return best


def identify(
    plant: Plant, u: Array, y: Array, start: Array | None = None, *, beyond: bool = False
) -> Identified:
    """Find the parameters behind outputs (B, N) of inputs (N,), (1, N) or (B, N).

    Of several channels outputs are (B, q, N) or stacked, and inputs (m, N), (1, m, N) or (B, m, N).

    Parameters
    ----------
    start : (B, p) float64, optional
        Where the search starts; the middle of the prior if omitted.
    beyond : bool
        Whether it may leave the prior, to the plant's search limits.  A search that does so at
        once may end in a minimum that is none of the prior's.
    """
    slopes: Sensitivity = plant.sensitivity or Differences(plant)
    u, y = u[None] if u.ndim == plant.u.ndim else u, plant.stacked(y)
    count, q = len(y), len(plant.unknown)
    theta = np.tile(plant.middle, (count, 1)) if start is None else start.copy()
    low, high = (slopes.encode(end[None]) for end in (plant.limits if beyond else plant.ranges))
    z = slopes.encode(theta)
    cost, gram = np.full(count, np.inf), np.zeros((count, 1 + q, 1 + q))
    damping, step = np.full(count, 1e-6), np.zeros((count, q))
    converged, steps = np.zeros(count, dtype=np.bool_), np.zeros(count, dtype=np.int64)
    rounding = _ROUNDING * np.einsum("bn,bn->b", y, y)
    # With an emulator's slopes the last steps promise what they do not keep, at a call each.
    unseen = 0.0 if plant.emulated(u) is plant else _UNSEEN_GAIN / y.shape[1]
    active = np.arange(count)
    for _ in range(_MAX_STEPS):
        trial = z[active] + step[active]
        found = slopes.gram(slopes.decode(trial, theta[active]), u, y, active)
        steps[active] += 1
        better = found[:, 0, 0] < cost[active]  # not where the simulator gave nan
        gained = np.where(better, cost[active] - found[:, 0, 0], 0.0)
        to = active[better]
        z[to], cost[to], gram[to] = trial[better], found[better, 0, 0], found[better]
        damping[active] *= np.where(better, 0.1, 100.0)
        full, promised = _step(gram[active], damping[active], z[active], low, high)
        step[active] = _until_limit(z[active], slopes.shortened(full), low, high) - z[active]
        done = promised <= max(_TOLERANCE, unseen) * cost[active] + rounding[active]
        done &= gained <= max(_GAINED, unseen) * cost[active] + rounding[active]
        ended = active[done]
        converged[ended] = (np.einsum("bii->bi", gram[ended])[:, 1:] > 0).any(axis=1) | (q == 0)
        active = active[~done & (damping[active] < _DAMPING) & np.isfinite(cost[active])]
        if not len(active):
            break
    converged &= ~_stopped(slopes, plant, z, low, high)
    return Identified(slopes.decode(z, theta), cost, converged, steps)


def output_slopes(plant: Plant, theta: Array, u: Array | None = None) -> Array:
    """Derivatives of stacked outputs to the unknown parameters in their widths, (B, q, N).

    Of a slow plant they are its emulator's, where that knows the input.
    """
    sides = 2 * len(plant.unknown)
    own = u is not None and u.ndim > plant.u.ndim and len(u) > 1
    tiled = np.tile(u, (sides, *(1,) * plant.u.ndim)) if own and u is not None else u
    plant = plant.emulated(u)
    return central(plant, theta, lambda t: plant.answers(t, tiled)).swapaxes(1, 2)


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


def moved(plant: Plant, theta: Array, step: Array, low: Array, high: Array) -> Array:
    """Parameters after steps (B, q) in widths, each as far as the first limit that it meets."""
    free, found = plant.unknown, theta.copy()
    found[:, free] = _until_limit(theta[:, free], step * plant.width, low[free], high[free])
    return found


def _until_limit(at: Array, change: Array, low: Array, high: Array) -> Array:
    """Values (B, q) after a change, as far as the first limit that it meets."""
    end = at + change
    if ((low <= end) & (end <= high)).all():
        return end
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(change > 0, high - at, low - at) / change
    room = np.where(change == 0, 1.0, np.maximum(room, 0.0))
    fraction = room.min(axis=1, keepdims=True, initial=1.0)
    return np.asarray(np.clip(at + fraction * change, low, high))


def drawn_to_prior(slopes: Array, noise: Array) -> tuple[Array, Array]:
    """Inverse normal matrices, and covariances, of parameters drawn to the prior.

    A uniform range has a variance of 1/12 of its width squared, whose inverse is added to the
    Fisher information: what a recording does not show stays as uncertain as the prior leaves it.

    Parameters
    ----------
    slopes : (B, q, N) float64
        Of outputs, in the parameters' widths.
    noise : (B,) float64
        Mean squares.

    Returns
    -------
    inverse : (B, q, q) float64
        By which inner products of slopes and output errors become steps; none without information.
    covariance : (B, q, q) float64
        In widths; ``inf`` on the diagonal where a slope is not finite.
    """
    gram = slopes @ slopes.swapaxes(1, 2)
    regular = np.isfinite(gram).all(axis=(1, 2)) & np.isfinite(noise)
    values, vectors = np.linalg.eigh(np.where(regular[:, None, None], gram, 0.0))
    shown = values > _UNSEEN * values.max(axis=1, keepdims=True, initial=0.0)
    variance = noise[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.where(shown, 1 / (values + variance / UNIFORM), 0.0)
    left = np.where(shown, variance * inverse, UNIFORM)
    turned = vectors.swapaxes(1, 2)
    covariance = (vectors * left[:, None]) @ turned
    infinite = np.where(np.eye(gram.shape[1]) > 0, np.inf, 0.0)
    covariance = np.where(regular[:, None, None], covariance, infinite)
    return (vectors * inverse[:, None]) @ turned, covariance


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
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.linalg.inv(np.where(regular[:, None, None], normal, eye)) / outer
    return np.where(regular[:, None, None], inverse, np.where(eye > 0, np.inf, 0.0))


def _step(gram: Array, damping: Array, z: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Damped Gauss-Newton steps (B, q) away from limits, and the decrease they promise (B,)."""
    slope, normal = gram[:, 0, 1:], gram[:, 1:, 1:]
    free = _inward(slope, z, low, high)
    step = _damped(normal, slope, damping, free)
    if _near(z, low, high).any():
        for _ in range(z.shape[1] - 1):  # it may press against a limit where the slope does not
            free &= _inward(step, z, low, high)
            step = _damped(normal, slope, damping, free)
    return step, np.asarray((step * slope).sum(axis=1))


def _inward(direction: Array, z: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    """Which coordinates (B, q) have room in a direction (B, q)."""
    return np.where(direction < 0, z - low > _ROOM, high - z > _ROOM)


def _damped(normal: Array, slope: Array, damping: Array, free: NDArray[np.bool_]) -> Array:
    """Damped Gauss-Newton steps (B, q) in the coordinates that are free."""
    eye = np.eye(slope.shape[1])
    mask = free[:, :, None] & free[:, None, :]
    scale = np.einsum("bii->bi", normal).max(axis=1, initial=0.0)
    scale = np.where(scale > 0, scale, 1.0)[:, None, None]
    lifted = np.where(mask, normal, 0.0) * (1 + damping[:, None, None] * eye)
    lifted = lifted + (~free[:, :, None] * eye + 1e-14) * scale * eye
    return np.asarray(np.linalg.solve(lifted, np.where(free, slope, 0.0)[..., None])[..., 0])


def _near(z: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    """Which coordinates (B, q) are on a limit."""
    return np.asarray((z - low <= _ROOM) | (high - z <= _ROOM))


def _stopped(
    slopes: Sensitivity, plant: Plant, z: Array, low: Array, high: Array
) -> NDArray[np.bool_]:
    """Whether a search ended at a limit outside the prior, (B,)."""
    first, last = (slopes.encode(end[None]) for end in plant.ranges)
    outside = (z < first - _ROOM) | (z > last + _ROOM)
    return np.asarray((_near(z, low, high) & outside).any(axis=1))
