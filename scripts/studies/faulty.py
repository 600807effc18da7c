"""Recordings that are not what they claim, the truth behind them, and gains judged by it."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tuners.tuner.recording import Recording
from yawrate_env.batch import take
from yawrate_env.compiled import LANES, over_blocks
from yawrate_env.loop.design import Status
from yawrate_env.loop.loops import Loops
from yawrate_env.vehicle.episode import excitation, loops
from yawrate_env.vehicle.single_track import Context, Vehicle
from yawrate_env.vehicle.task import Task

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Rng = np.random.Generator


@dataclass(frozen=True, slots=True, eq=False)
class Faulty:
    """Recordings as a tuner is given them, and the truth.

    Attributes
    ----------
    recording : Recording
        What is claimed.
    context : Context
        True vehicles.
    real : bool
        Whether any vehicle stands behind the signals at all.
    gain : float or NDArray
        (B,) of the yaw-rate sensor, in the loop as in the recording.
    """

    recording: Recording
    context: Context
    real: bool = True
    gain: float | Array = 1.0

    def part(self, index: slice) -> "Faulty":
        """Some of them."""
        gain = np.broadcast_to(self.gain, len(self.recording))[index]
        return replace(
            self, recording=self.recording.part(index), context=take(self.context, index), gain=gain
        )

    def reached(self, task: Task, gains: Array) -> tuple[Array, Flags]:
        """Phase margin [deg] and crossover [Hz] (B, 2) of gains (B, 2), and stability (B,)."""
        kp, Ti = gains.T
        return _evaluated(loops(task, self.context), kp * self.gain, Ti)

    def reachable(self, task: Task) -> tuple[Array, Flags]:
        """What the design rule reaches with the true vehicles (B, 2), and where it is the target.

        Where it is out of reach, gains come as near as a PI can.
        """
        truth = loops(task, self.context)
        found = truth.design()
        return _evaluated(truth, found.kp, found.Ti)[0], found.status == Status.OK


def of_prior(task: Task, rng: Rng, count: int) -> Context:
    """Vehicles of the prior."""
    prior = task.prior
    ranges = prior.mu_s, prior.M_delta, prior.v_x
    mu_s, M_delta, v_x = (rng.uniform(low, high, count) for low, high in ranges)
    return Context(mu_s, M_delta, v_x)


def commands(task: Task, rng: Rng, count: int, Ts: float | None = None) -> Array:
    """Steering commands (B, N) of the task's experiment, or of one at another `Ts` [s]."""
    own = replace(task.experiment, Ts=Ts or task.experiment.Ts)
    start = rng.integers(0, 2**63, count, dtype=np.uint64)
    return np.broadcast_to(excitation(own, start), (count, own.N)).copy()


def driven(task: Task, context: Context, u: Array, Ts: float | None = None) -> Array:
    """Noise-free yaw rates (B, N) of vehicles steered by (B, N)."""
    y = np.empty(u.shape)
    into = task.twin.simulator(task.vehicle, context, u, Ts or task.experiment.Ts)

    def work(i: int, j: int) -> None:
        into(y[i:j], i, j)

    over_blocks(work, len(context), LANES)
    return y


def deviation(task: Task, clean: Array) -> Array:
    """Standard deviation (B, 1) of the noise on yaw rates (B, N)."""
    return strength(clean) * 10 ** (-task.experiment.snr_db / 20)


def strength(values: Array) -> Array:
    """Root mean square of each row, (B, 1)."""
    return np.asarray(np.sqrt((values**2).mean(axis=1, keepdims=True)))


def recorded(
    task: Task, context: Context, rng: Rng, Ts: float | None = None
) -> tuple[Array, Array, Array]:
    """Command (B, N), noise-free yaw rate (B, N) and the noise to add (B, N)."""
    u = commands(task, rng, len(context), Ts)
    clean = driven(task, context, u, Ts)
    return u, clean, deviation(task, clean) * rng.standard_normal(clean.shape)


def scaled(vehicle: Vehicle, context: Context, name: str, factor: Array) -> Context:
    """Vehicles with one of the parameters of `Vehicle` multiplied by (B,)."""
    if name == "M_0":
        return replace(context, M_delta=context.M_delta + vehicle.M_0 * (factor - 1))
    usual = context.others.get(name, getattr(vehicle, name))
    return replace(context, others={**context.others, name: usual * factor})


def claimed_speed(v_x: Array) -> Array:
    """Known parameters (B, 3) of recordings that come with a speed [m/s], (B,)."""
    known = np.full((len(v_x), 3), np.nan)
    known[:, 2] = v_x
    return known


def _evaluated(truth: Loops, kp: Array, Ti: Array) -> tuple[Array, Flags]:
    found = truth.evaluate(kp, Ti)
    return np.stack([found.margins.phase_margin, found.margins.crossover], axis=1), found.stable
