"""How much of an episode's Fisher information is left in its features.

Features that move with theta = (log mu_s, log M_veh) by ``D`` and scatter with covariance
``C`` hold ``D^T C^-1 D`` of it for an estimator that works with their mean and covariance.

Laguerre coefficients are linear in the output, ``c = (Phi^T Phi)^-1 Phi^T y``, so that this
is ``S^T P S / sigma^2`` with the output's sensitivity S and the projection P on the
regressors Phi.  The ARMAX fit is not, and its reduced order makes its features depend on
the noise: D and C come from recordings of the same vehicle with fresh noise.
"""

import numpy as np
from numpy.typing import NDArray

from tuners.features.armax import Armax
from tuners.features.laguerre import Laguerre, lifted
from tuners.trust.vehicle_bound import noise_variance
from yawrate_env.batch import take
from yawrate_env.loop.simulation import simulate
from yawrate_env.signals.decimation import averaged
from yawrate_env.vehicle.episode import Draw, excitation, plants
from yawrate_env.vehicle.single_track import Context, total_mass
from yawrate_env.vehicle.task import Task

Array = NDArray[np.float64]

RECORDINGS = 100
_STEP = 1e-4  # of the logarithms, for what is linear in the output
_FINITE = 3e-3  # for what is not; the same noise on both sides


def after_averaging(task: Task, draw: Draw, block: int) -> Array:
    """Information that block averages keep, (B, 2, 2)."""
    clean, S = _sensitivities(task, draw)
    A = averaged(S, block)
    variance = noise_variance(task, clean) / block
    return np.asarray(A @ A.swapaxes(1, 2) / variance[:, None, None])


def in_laguerre(task: Task, draw: Draw, compressor: Laguerre) -> Array:
    """Information in Laguerre coefficients, (B, 2, 2)."""
    clean, S = _sensitivities(task, draw)
    u, none = excitation(task.experiment, draw.start), np.empty((0, task.experiment.N))
    sides = [
        compressor.normal_equations(u, np.ascontiguousarray(S[:, i]), task.experiment.Ts, none)
        for i in range(2)
    ]
    gram, right = lifted(sides[0][0]), np.stack([right for _, right in sides], axis=2)
    kept = right.swapaxes(1, 2) @ np.linalg.solve(gram, right)
    return np.asarray(kept / noise_variance(task, clean)[:, None, None])


def in_armax(
    task: Task, draw: Draw, compressor: Armax, seed: int = 0, recordings: int = RECORDINGS
) -> Array:
    """Information in ARMAX coefficients, (B, 2, 2), from `recordings` of each vehicle."""
    rng = np.random.default_rng(seed)
    u = np.broadcast_to(excitation(task.experiment, draw.start), (len(draw), task.experiment.N))
    each = [take(draw.context, slice(b, b + 1)) for b in range(len(draw))]
    return np.stack(
        [
            _in_armax(task, one, u[b : b + 1], compressor, rng, recordings)
            for b, one in enumerate(each)
        ]
    )


def _in_armax(
    task: Task,
    context: Context,
    u: Array,
    compressor: Armax,
    rng: np.random.Generator,
    recordings: int,
) -> Array:
    """`in_armax` of one vehicle, (2, 2); averages of white noise are white, and drawn as such."""
    Ts = task.experiment.Ts
    block = round(compressor.Ts / Ts)
    centre = simulate(plants(task.vehicle, context, Ts), u)
    sigma = np.sqrt(noise_variance(task, centre) / block)
    noise = sigma * rng.standard_normal((recordings, u.shape[1] // block))

    def features(moved: Context) -> Array:
        clean = averaged(simulate(plants(task.vehicle, moved, Ts), u), block)
        return compressor(averaged(u, block), clean + noise, compressor.Ts)[0]

    sides = [[features(c) for c in side] for side in _beside(task, context, _FINITE)]
    D = np.stack([(up - down).mean(axis=0) for up, down in sides], axis=1) / (2 * _FINITE)
    C = np.cov(features(context).T)
    # An inverse of a sample covariance is too large on average (Hartlap et al., 2007).
    unbiased = (recordings - len(C) - 2) / (recordings - 1)
    return np.asarray(unbiased * D.T @ np.linalg.solve(C, D))


def _sensitivities(task: Task, draw: Draw) -> tuple[Array, Array]:
    """Outputs without noise (B, N), and their derivatives to the logarithms (B, 2, N)."""
    u = excitation(task.experiment, draw.start)

    def output(context: Context) -> Array:
        return simulate(plants(task.vehicle, context, task.experiment.Ts), u)

    sides = _beside(task, draw.context, _STEP)
    S = [(output(up) - output(down)) / (2 * _STEP) for up, down in sides]
    return output(draw.context), np.stack(S, axis=1)


def _beside(task: Task, context: Context, step: float) -> list[tuple[Context, Context]]:
    """Vehicles with more and with less of log mu_s, and of log M_veh."""
    mass = total_mass(task.vehicle, context)

    def moved(by_mu_s: float, by_mass: float) -> Context:
        mu_s = context.mu_s * np.exp(by_mu_s)
        return Context(mu_s, mass * np.exp(by_mass) - task.vehicle.M_0, context.v_x)

    return [(moved(step, 0), moved(-step, 0)), (moved(0, step), moved(0, -step))]
