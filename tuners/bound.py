"""The Cramer-Rao bound on phase margin and crossover.

The Fisher information of theta = (log mu_s, log M_veh) in an episode with white noise of
variance sigma^2 is ``F = sum_k (dy_k/dtheta)(dy_k/dtheta)^T / sigma^2`` (Ljung, *System
Identification*, 2nd ed., section 7.4).  Whoever estimates theta without bias, designs
with the estimate and closes the loop around the true vehicle spreads (phase margin,
crossover) by at least ``J F^-1 J^T``, J being the derivative of "design with theta',
measure on theta" with respect to theta' at the truth.
"""

import numpy as np
from numpy.typing import NDArray

from tuners.identification import output_gram
from tuners.recording import Recording
from yawrate_env.episode import Draw, excitation, plants
from yawrate_env.judge import Judge
from yawrate_env.simulation import simulate
from yawrate_env.task import Task
from yawrate_env.vehicle import Context, total_mass

Array = NDArray[np.float64]

_STEP = 1e-4  # of the logarithms, central: truncation and rounding both below 1e-6


def cramer_rao(task: Task, draw: Draw) -> Array:
    """Least standard deviations of phase margin [deg] and crossover [Hz], (B, 2).

    Friction and mass are unknown; speed and everything else is known.
    """
    u = excitation(task.experiment, draw.start)
    clean = simulate(plants(task.vehicle, draw.context, task.experiment.Ts), u)
    variance = (clean**2).mean(axis=1) * 10 ** (-task.experiment.snr_db / 10)
    recording = Recording(u, clean, task.experiment.Ts)
    gram = output_gram(task.vehicle, draw.context, recording, np.arange(len(draw)))
    covariance = np.linalg.inv(gram[:, 1:, 1:] / variance[:, None, None])
    J = margin_sensitivity(task, draw.context)
    spread = np.einsum("bij,bjk,bik->bi", J, covariance, J)
    return np.asarray(np.sqrt(spread))


def margin_sensitivity(task: Task, context: Context) -> Array:
    """Derivative of (phase margin [deg], crossover [Hz]) to the logarithms, (B, 2, 2)."""
    truth = Judge.of(task, context)
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
            gains = Judge.of(task, estimate).oracle()
            found = truth(gains.kp, gains.Ti).margins
            sides.append(np.stack([found.phase_margin, found.crossover], axis=1))
        columns.append((sides[0] - sides[1]) / (2 * _STEP))
    return np.stack(columns, axis=2)
