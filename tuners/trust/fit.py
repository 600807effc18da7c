"""Fit of a plant to recordings: parameters, residuals and covariance.

Where a recording does not start from rest, initial state and offsets are estimated too: the
steps use signals from which free responses are projected out (variable projection, Golub and
Pereyra, 1973).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.trust.actuator_curve import actuator_curves
from tuners.trust.actuator_memory import sticking
from tuners.trust.black_box import BlackBox
from tuners.trust.discrepancy import Discrepancy
from tuners.trust.identification import (
    LARGEST_STEP,
    UNIFORM,
    Identified,
    drawn_to_prior,
    identify,
    identify_from_several,
    moved,
    output_slopes,
)
from tuners.trust.local_emulator import locally_emulated
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

_POLISHING = 20  # steps at most
_UNSEEN = 1e-3  # of the noise's variance: a step that changes the output by less is none
_SETTLED = 1e-4  # of a range: the last step is no longer
_OPEN = 0.5  # of the prior's standard deviation: a parameter that a recording leaves open
_BAND = (1 / 7.5, 1 / 0.3)  # of the crossover: where noise matters to the metrics
_COLOURED = 1.7  # noise stronger by this in the band: more than chance for white noise


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Plants fitted to B recordings.

    Attributes
    ----------
    theta : NDArray
        (B, p) parameters found, those that are measured as given.
    converged : NDArray
        (B,) whether the search ended at a minimum.
    simulated : NDArray
        (B, N) the plant's output, with offset and start where these were estimated.
    residual : NDArray
        (B, N) measured minus simulated.
    noise : NDArray
        (B,) mean square of the residual, or more where it is stronger around the
        crossover than elsewhere.
    covariance : NDArray
        (B, q, q) of the unknown parameters in widths of their ranges; the prior's where the
        data do not determine them.
    discrepancy : Discrepancy, optional
        How far off the plants may be, where no response of the black box judges.
    sticking : NDArray, optional
        (B, m, q) errors of the unknown parameters under an actuator that sticks or follows late,
        of linear plants where no response of the black box judges.
    """

    theta: Array
    converged: NDArray[np.bool_]
    simulated: Array
    residual: Array
    noise: Array
    covariance: Array
    discrepancy: Discrepancy | None
    sticking: Array | None = None


def fit(plant: Plant, model: BlackBox, measured: Array, start: Array) -> Fit:
    """Fit plants to recordings that may start in motion.

    Parameters
    ----------
    model : BlackBox
        The reference model, which holds the recordings without initial state and offsets.
    measured : (B, N) or (B, q, N) float64
        Outputs as recorded.
    start : (B, p) float64
        Where the search starts, with the measured parameters of the recordings.
    """
    plant = locally_emulated(plant, model, start)
    found = search(plant, model.u, model.y, start)
    theta, limits, measured = found.theta.copy(), plant.limits, plant.stacked(measured)
    settled, rows = ~model.unknown, np.flatnonzero(model.unknown)
    moving = model.some(rows)
    for _ in range(_POLISHING):
        if settled.all():
            break
        error, slopes = signals(plant, theta[rows], moving)
        inverse, _ = drawn_to_prior(slopes, (error**2).mean(axis=1))
        step = (inverse @ np.einsum("bqn,bn->bq", slopes, error)[..., None])[..., 0]
        step = np.where(np.isfinite(step), step, 0.0)
        within = np.clip(step, -LARGEST_STEP, LARGEST_STEP)
        theta[rows] = moved(plant, theta[rows], within, *limits)
        gained = (np.einsum("bq,bqn->bn", step, slopes) ** 2).sum(axis=1)  # of what noise may do
        settled[rows] = np.abs(step).max(axis=1, initial=0.0) <= _SETTLED
        settled[rows] |= gained <= _UNSEEN * (error**2).mean(axis=1)
    error, slopes = signals(plant, theta, model)
    noise = noise_level(error, model.Ts, plant.crossover)
    if plant.crossover is None:  # interpolation reduces the noise of most frequencies
        noise = noise * model.oversampled
    inverse, covariance = drawn_to_prior(slopes, noise)
    converged = np.where(model.unknown, settled, found.converged)
    simulated, discrepancy, stuck = measured - error, None, None
    if plant.loop_target is None:
        stuck = sticking(plant, theta, model, error, slopes, noise, inverse)
        discrepancy = Discrepancy.of(
            error, slopes, simulated, noise, inverse, covariance, model.oversampled,
            len(plant.outputs_named), actuator_curves(plant, theta, model),
        )  # fmt: skip
    return Fit(theta, converged, simulated, error, noise, covariance, discrepancy, stuck)


def left_open(found: Fit) -> NDArray[np.bool_]:
    """Which unknown parameters (B, q) recordings hardly tell: most of the prior remains."""
    return np.asarray(np.einsum("bii->bi", found.covariance) > _OPEN**2 * UNIFORM)


def search(plant: Plant, u: Array, y: Array, start: Array) -> Identified:
    """Find a plant anywhere within its search limits.

    With exact slopes one start is enough, as is the end of the search for a linear model's
    parameters, or with an emulator; without them several starts within the prior come first.
    """
    emulated = plant.emulated(u)
    rougher = plant.linear_model if emulated is plant else emulated
    if rougher is not None:
        rough = search(rougher, u, y, start).theta
        begin = np.clip(rough, *plant.limits)
        begin[:, plant.known] = start[:, plant.known]
    elif plant.sensitivity is not None:
        begin = start
    else:
        begin = identify_from_several(plant, u, y, start).theta
    return identify(plant, u, y, begin, beyond=True)


def noise_level(residual: Array, Ts: float, crossover: float | None) -> Array:
    """Mean square of residuals (B, N), or their power around the crossover if that is more.

    What counts for the metrics is noise that the input could have caused.  White noise
    has the same power everywhere, and its mean square is the better estimate of it.
    """
    overall = (residual**2).mean(axis=1)
    if crossover is None:
        return np.asarray(overall)
    N = residual.shape[1]
    power = (np.abs(np.fft.rfft(residual)[:, _band(N, Ts, crossover)]) ** 2).mean(axis=1) / N
    return np.asarray(np.where(power > _COLOURED * overall, power, overall))


def most_coloured(N: int, Ts: float, crossover: float) -> float:
    """How many times stronger than white noise a residual is with all its power in the band."""
    band = _band(N, Ts, crossover)
    return float((N // 2) / (min(band.stop, N // 2 + 1) - band.start))


def _band(N: int, Ts: float, crossover: float) -> slice:
    """Around the crossover, in a residual's Fourier transform."""
    low, high = (max(round(f * crossover * N * Ts), 1) for f in _BAND)
    return slice(min(low, N // 2), high + 1)


def signals(plant: Plant, theta: Array, model: BlackBox) -> tuple[Array, Array]:
    """Output errors (B, N) and slopes (B, q, N), free responses projected out where unknown."""
    error = model.y - plant.answers(theta, model.u)
    signals = np.concatenate([error[:, None], output_slopes(plant, theta, model.u)], axis=1)
    signals = model.projected(signals)
    return signals[:, 0], signals[:, 1:]
