"""What no tuner can beat: the Cramer-Rao bound, and the posterior spread under the prior.

The Fisher information of theta = (log mu_s, log M_veh) in an episode with white noise of
variance sigma^2 is ``F = sum_k (dy_k/dtheta)(dy_k/dtheta)^T / sigma^2`` (Ljung, *System
Identification*, 2nd ed., section 7.4).  Whoever estimates theta without bias, designs
with the estimate and closes the loop around the true vehicle spreads (phase margin,
crossover) by at least ``J F^-1 J^T``, J being the derivative of "design with theta',
measure on theta" with respect to theta' at the truth.

Who knows the prior may be biased and pass below that bound near the edges of the box that
(mu_s, M_delta) are drawn from, but not below the posterior spread on average.  An episode
says of them what the least-squares estimate does, which is Gaussian about the truth with
covariance ``F^-1`` as far as the model is linear; the posterior is that Gaussian about the
estimate, cut off at the box.
"""

from itertools import product

import numpy as np
from numpy.polynomial.hermite_e import hermegauss
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from tuners.trust.vehicle_identification import output_gram
from tuners.tuner.recording import Recording
from yawrate_env.loop.simulation import simulate
from yawrate_env.vehicle.episode import Draw, excitation, loops, plants
from yawrate_env.vehicle.single_track import Context, total_mass
from yawrate_env.vehicle.task import Task

Array = NDArray[np.float64]

_STEP = 1e-4  # of the logarithms, central: truncation and rounding both below 1e-6
_REACH = 8.0  # standard deviations beyond which a Gaussian weighs nothing
_NODES = 40  # in each of five panels: a Gaussian in one of them to 1e-9
_ESTIMATES = 9  # quadrature nodes in each direction of the estimate's own scatter


def cramer_rao(task: Task, draw: Draw) -> Array:
    """Least standard deviations of phase_margin [deg] and crossover [Hz], (B, 2).

    Friction and mass are unknown; speed and everything else is known.
    """
    return spread(margin_sensitivity(task, draw.context), inverse(information(task, draw)))


def posterior_spread(task: Task, draw: Draw) -> Array:
    """Root of the Bayes risk of phase_margin [deg] and crossover [Hz], (B, 2).

    Of the best estimator that knows the prior, at each vehicle and over the noise.  Its root
    mean square over the prior is the least that any estimator reaches; at a single vehicle
    near an edge another may do better.
    """
    prior = task.prior
    box = np.array([prior.mu_s, prior.M_delta])
    if not (box[:, 1] > box[:, 0]).all():
        raise ValueError(
            f"mu_s = {prior.mu_s} and M_delta = {prior.M_delta} must be ranges, low < high. "
            "A known parameter has no posterior; widen its range."
        )
    truth = np.stack([draw.context.mu_s, draw.context.M_delta], axis=1)
    if ((truth < box[:, 0]) | (truth > box[:, 1])).any():
        raise ValueError(
            f"Some vehicles lie outside mu_s = {prior.mu_s} and M_delta = {prior.M_delta}, which "
            "the posterior rules out. Give the task the prior that they were drawn from."
        )
    by_log = np.stack([draw.context.mu_s, total_mass(task.vehicle, draw.context)], axis=1)
    root = by_log[:, :, None] * np.linalg.cholesky(inverse(information(task, draw)))
    nodes, weights = hermegauss(_ESTIMATES)
    risk = np.zeros((len(draw), 2, 2))
    for i, j in product(range(_ESTIMATES), repeat=2):
        estimate = truth + root @ np.array([nodes[i], nodes[j]])
        risk += weights[i] * weights[j] * truncated_covariance(estimate, root, *box.T)
    risk /= weights.sum() ** 2
    return spread(margin_sensitivity(task, draw.context) / by_log[:, None], risk)


def spread(J: Array, covariance: Array) -> Array:
    """Standard deviations of ``J theta`` where theta has a covariance, (B, 2)."""
    return np.asarray(np.sqrt(np.einsum("bij,bjk,bik->bi", J, covariance, J)))


def inverse(matrices: Array) -> Array:
    """Covariances from information, and back."""
    return np.asarray(np.linalg.inv(matrices), dtype=np.float64)


def information(task: Task, draw: Draw) -> Array:
    """Fisher information of (log mu_s, log M_veh) in each episode, (B, 2, 2)."""
    u = excitation(task.experiment, draw.start)
    clean = simulate(plants(task.vehicle, draw.context, task.experiment.Ts), u)
    recording = Recording(u, clean, task.experiment.Ts)
    gram = output_gram(task.vehicle, draw.context, recording, np.arange(len(draw)))
    return np.asarray(gram[:, 1:, 1:] / noise_variance(task, clean)[:, None, None])


def noise_variance(task: Task, clean: Array) -> Array:
    """Of the yaw rate [(rad/s)^2], (B,), for outputs without noise (B, N)."""
    return np.asarray((clean**2).mean(axis=1) * 10 ** (-task.experiment.snr_db / 10))


def truncated_covariance(mean: Array, root: Array, low: Array, high: Array) -> Array:
    """Covariance of Gaussians that are cut off at a box, (B, 2, 2).

    With ``x = mean + root w`` the side of the box for x_1 bounds w_1 alone, and given w_1 that
    for x_2 bounds w_2, whose moments over an interval are known.  What is left is an integral
    over w_1, smooth between the points where the bounds of w_2 enter and leave its reach.

    Parameters
    ----------
    mean : (B, 2) float64
        Middle of the whole Gaussians.
    root : (B, 2, 2) float64
        Lower triangular roots of their covariances.
    low, high : (2,) float64
        Sides of the box.
    """
    a, c, d = root[:, 0, 0, None], root[:, 1, 0, None], root[:, 1, 1, None]
    ends = np.clip((np.stack([low, high]) - mean[:, None])[:, :, 0] / a, -_REACH, _REACH)
    sides = (np.stack([low, high]) - mean[:, None])[:, :, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        kinks = np.concatenate([(sides - reach * d) / c for reach in (-_REACH, _REACH)], axis=1)
    kinks = np.clip(np.nan_to_num(kinks), ends[:, :1], ends[:, 1:])
    edges = np.sort(np.concatenate([ends, kinks], axis=1), axis=1)
    nodes, weights = leggauss(_NODES)
    half, middle = np.diff(edges)[..., None] / 2, (edges[:, 1:] + edges[:, :-1])[..., None] / 2
    w = (middle + half * nodes).reshape(len(mean), -1)
    weight = (half * weights).reshape(w.shape) * np.exp(-(w**2) / 2)
    m0, m1, m2 = _moments((sides[:, :1] - c * w) / d, (sides[:, 1:] - c * w) / d)

    def mean_of(values: Array) -> Array:
        return np.asarray((weight * values).sum(axis=1) / (weight * m0).sum(axis=1))

    first = np.stack([mean_of(w * m0), mean_of(m1)], axis=1)
    cross = mean_of(w * m1)
    second = np.array([[mean_of(w * w * m0), cross], [cross, mean_of(m2)]]).transpose(2, 0, 1)
    inner = second - first[:, :, None] * first[:, None, :]
    return np.asarray(root @ inner @ root.swapaxes(1, 2))


def _moments(low: Array, high: Array) -> tuple[Array, Array, Array]:
    """Integrals of 1, w and w^2 times the standard normal density from `low` to `high`."""
    from scipy.special import ndtr

    low, high = np.clip(low, -40, 40), np.clip(high, -40, 40)
    at_low, at_high = (np.exp(-(w**2) / 2) / np.sqrt(2 * np.pi) for w in (low, high))
    upper = low + high > 0  # there the difference of the complements has all the digits
    m0 = np.where(upper, ndtr(-low) - ndtr(-high), ndtr(high) - ndtr(low))
    return m0, at_low - at_high, m0 + low * at_low - high * at_high


def margin_sensitivity(task: Task, context: Context) -> Array:
    """Derivative of (phase_margin [deg], crossover [Hz]) to the logarithms, (B, 2, 2)."""
    truth = loops(task, context)
    mass = total_mass(task.vehicle, context)
    columns = []
    for by_mu_s, by_mass in ((_STEP, 0.0), (0.0, _STEP)):
        sides = []
        for sign in (1, -1):
            estimate = Context(
                context.mu_s * np.exp(sign * by_mu_s),
                mass * np.exp(sign * by_mass) - task.vehicle.M_0,
                context.v_x,
            )
            gains = loops(task, estimate).design()
            found = truth(gains.kp, gains.Ti).margins
            sides.append(np.stack([found.phase_margin, found.crossover], axis=1))
        columns.append((sides[0] - sides[1]) / (2 * _STEP))
    return np.stack(columns, axis=2)
