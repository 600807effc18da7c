"""The simulator beside recordings: which vehicles they come from, and what that leaves over.

Friction and total mass are identified as the gray box does it.  Where an episode does not
start from rest, its start and offsets are estimated along with them: Gauss-Newton steps
on signals from which all that the start could explain has been projected out
(Golub and Pereyra's variable projection, 1973).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.identification import identify
from tuners.recording import Recording
from tuners.start import BlackBox, free_responses
from yawrate_env.episode import plants
from yawrate_env.simulation import simulate
from yawrate_env.task import Task
from yawrate_env.vehicle import Context, Vehicle, total_mass

Array = NDArray[np.float64]

_STEP = 1e-4  # of the logarithms, central
_POLISHING = 3
_BAND = (0.2, 5.0)  # Hz, around any crossover: where noise matters to the margins
_FRICTION, _MASS = (1e-3, 1e2), (1.0, 1e6)
_COLOURED = 1.7  # noise stronger by this in the band: more than chance for white noise


@dataclass(frozen=True, slots=True, eq=False)
class Twins:
    """Identified vehicles of B episodes and what they leave over.

    Attributes
    ----------
    context : Context
        Friction and mass found, speed as given.
    converged : NDArray
        (B,) whether the search ended at a minimum.
    simulated : NDArray
        (B, N) yaw rate, with offset and start where these were estimated [rad/s].
    residual : NDArray
        (B, N) measured minus simulated [rad/s].
    noise : NDArray
        (B,) mean square of the residual, or more where it is stronger around the
        crossover than elsewhere [(rad/s)^2].
    covariance : NDArray
        (B, 2, 2) of the logarithms of friction and total mass.
    """

    context: Context
    converged: NDArray[np.bool_]
    simulated: Array
    residual: Array
    noise: Array
    covariance: Array


def fit(task: Task, start: Context, model: BlackBox, measured: Array, v_x: Array) -> Twins:
    """Identify the vehicle behind every episode.

    Parameters
    ----------
    start : Context
        One vehicle, where the search starts.
    model : BlackBox
        The episodes, start and offsets taken out.
    measured : (B, N) float64
        Yaw rates as recorded [rad/s].
    v_x : (B,) float64
        Speeds [m/s].
    """
    recording, vehicle = model.recording, task.vehicle
    Z, _ = free_responses(recording.y.shape[1], recording.Ts)
    found = identify(vehicle, recording, start, v_x)
    context = _physical(vehicle, found.context)
    for _ in range(_POLISHING if model.unknown.any() else 0):
        error, slopes = _signals(vehicle, context, recording, model.unknown, Z)
        normal, slope = slopes @ slopes.transpose(0, 2, 1), slopes @ error[..., None]
        with np.errstate(invalid="ignore"):
            step = (_inverse(normal) @ slope)[..., 0]
        step = np.where(model.unknown[:, None] & np.isfinite(step), np.clip(step, -0.5, 0.5), 0.0)
        context = _physical(vehicle, moved(vehicle, context, step))
    error, slopes = _signals(vehicle, context, recording, model.unknown, Z)
    noise = noise_level(error, recording.Ts)
    with np.errstate(invalid="ignore"):  # no noise and no information: no answer
        covariance = noise[:, None, None] * _inverse(slopes @ slopes.transpose(0, 2, 1))
    return Twins(context, found.converged, measured - error, error, noise, covariance)


def moved(vehicle: Vehicle, context: Context, step: Array) -> Context:
    """Vehicles with the logarithms of friction and total mass changed by (B, 2)."""
    mass = total_mass(vehicle, context) * np.exp(step[:, 1])
    return Context(context.mu_s * np.exp(step[:, 0]), mass - vehicle.M_0, context.v_x)


def _physical(vehicle: Vehicle, context: Context) -> Context:
    """Within bounds that no vehicle reaches; foreign recordings send the search anywhere."""
    mass = np.clip(vehicle.M_0 + context.M_delta, *_MASS)
    return Context(np.clip(context.mu_s, *_FRICTION), mass - vehicle.M_0, context.v_x)


def noise_level(residual: Array, Ts: float) -> Array:
    """Mean square of residuals (B, N), or their power around the crossover if that is more.

    What counts for the margins is noise that the command could have caused.  White noise
    has the same power everywhere, and its mean square is the better estimate of it.
    """
    N = residual.shape[1]
    low, high = (max(round(f * N * Ts), 1) for f in _BAND)
    power = (np.abs(np.fft.rfft(residual)[:, low : high + 1]) ** 2).mean(axis=1) / N
    overall = (residual**2).mean(axis=1)
    return np.asarray(np.where(power > _COLOURED * overall, power, overall))


def _signals(
    vehicle: Vehicle,
    context: Context,
    recording: Recording,
    unknown: NDArray[np.bool_],
    Z: Array,
) -> tuple[Array, Array]:
    """Output errors (B, N) and their descent to the logarithms (B, 2, N), starts projected out."""
    count = len(recording)
    sides = [np.zeros(2), *(sign * _STEP * row for row in np.eye(2) for sign in (1, -1))]
    outputs = [
        simulate(
            plants(vehicle, moved(vehicle, context, np.tile(side, (count, 1))), recording.Ts),
            recording.u,
        )
        for side in sides
    ]
    slopes = [(outputs[i] - outputs[i + 1]) / (2 * _STEP) for i in (1, 3)]
    signals = np.stack([recording.y - outputs[0], *slopes], axis=1)
    signals[unknown] -= signals[unknown] @ Z.T @ Z
    return signals[:, 0], signals[:, 1:]


def _inverse(matrix: Array) -> Array:
    """Inverse of (B, 2, 2) matrices; infinite where singular."""
    (a, b), (c, d) = matrix.transpose(1, 2, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
    return np.asarray(np.where(np.isfinite(scaled), scaled, np.inf).transpose(2, 0, 1))
