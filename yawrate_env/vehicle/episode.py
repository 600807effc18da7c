"""Identification episodes of vehicles: random integers to contexts, contexts to recordings.

Everything random about an episode comes from ``WORDS`` 64-bit words, drawn from the
environment's generator or from ``SeedSequence(root, spawn_key=(episode,))``; an
episode is therefore the same whatever batch it is computed in.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import LANES, over_blocks
from yawrate_env.loop.discretisation import DiscretePlant, zoh
from yawrate_env.loop.loops import Loops
from yawrate_env.signals.excitation import RANDOM_ORDER, prbs
from yawrate_env.signals.noise import KEY_WORDS, add_white_noise
from yawrate_env.signals.streams import uniform
from yawrate_env.vehicle.single_track import Context, Vehicle, state_space
from yawrate_env.vehicle.task import Experiment, Prior, Task

WORDS = 4 + KEY_WORDS
"""mu_s, M_delta, v_x, start of the register, and the noise stream's key."""


@dataclass(frozen=True, slots=True, eq=False)
class Draw:
    """B random episodes, before they are simulated.

    Attributes
    ----------
    context : Context
        The vehicles.
    start : NDArray
        (B,) uint64, where the random register starts.
    key : NDArray
        (B, 4) uint64, the noise streams.
    """

    context: Context
    start: NDArray[np.uint64]
    key: NDArray[np.uint64]

    @classmethod
    def of(cls, words: NDArray[np.uint64], prior: Prior) -> Self:
        """Turn (B, WORDS) random words into episodes of the prior."""
        unit = uniform(words[:, :3])
        low, high = np.array([prior.mu_s, prior.M_delta, prior.v_x]).T
        context = Context(*(low + (high - low) * unit).T.copy())
        return cls(context, words[:, 3], words[:, 4:])

    def __len__(self) -> int:
        return len(self.context)


def plants(vehicle: Vehicle, context: Context, Ts: float) -> DiscretePlant:
    """ZOH plants of the batch at `Ts` [s], from steering command to yaw rate."""
    return zoh(*state_space(vehicle, context), Ts)


def loops(task: Task, context: Context) -> Loops:
    """PI loops around the linear vehicles, at the controller's sampling time."""
    return Loops.of(plants(task.vehicle, context, task.target.Ts), task.target)


def excitation(experiment: Experiment, start: NDArray[np.uint64]) -> NDArray[np.float64]:
    """Steering commands [rad]: (1, N) for the same register, (B, N) for random ones."""
    timing = (experiment.N, experiment.Ts, experiment.bit_time, experiment.amplitude)
    if experiment.register == "same":
        return prbs(*timing)
    return prbs(*timing, order=RANDOM_ORDER, start=start)


def record(
    task: Task, draw: Draw, out: NDArray[np.floating] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.floating]]:
    """Simulate the episodes of a draw.

    Parameters
    ----------
    out : (B, N) float32 or float64, optional
        Where the yaw rates go; may be a strided view.

    Returns
    -------
    u : (1, N) or (B, N) float64
        Steering command [rad].
    y : (B, N)
        Yaw rate with white noise at the experiment's SNR [rad/s]; `out` if given.
    """
    u = excitation(task.experiment, draw.start)
    return u, respond(task, draw.context, u, draw.key, out)


def respond(
    task: Task,
    context: Context,
    u: NDArray[np.float64],
    key: NDArray[np.uint64],
    out: NDArray[np.floating] | None = None,
) -> NDArray[np.floating]:
    """Measured yaw rates (B, N) [rad/s] of vehicles steered by (1 or B, N) [rad].

    Parameters
    ----------
    key : (B, 4) uint64
        The noise streams.
    out : (B, N) float32 or float64, optional
        Where the yaw rates go; may be a strided view.
    """
    experiment = task.experiment
    simulate = task.twin.simulator(task.vehicle, context, u, experiment.Ts)
    y = np.empty((len(context), experiment.N)) if out is None else out
    noise_over_signal = 10 ** (-experiment.snr_db / 20)

    def work(i: int, j: int) -> None:
        clean = np.empty((j - i, experiment.N))
        squares = simulate(clean, i, j)
        sigma = noise_over_signal * np.sqrt(squares / experiment.N)
        add_white_noise(clean, sigma, key[i:j], y[i:j])

    over_blocks(work, len(context), LANES)
    return y
