"""Vehicles' experiments: discrete plants, loops, steering commands and noisy yaw rates, batched."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import LANES, over_blocks
from yawrate_env.loop.loops import Loops
from yawrate_env.signals.excitation import RANDOM_ORDER, prbs
from yawrate_env.signals.noise import add_white_noise
from yawrate_env.vehicle.discrete import plants as plants
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Experiment, Task


def loops(task: Task, context: Context) -> Loops:
    """PI loops around the linear vehicles, at the controller's sampling time."""
    return Loops.of(plants(task.vehicle, context, task.target.Ts), task.target)


def excitation(experiment: Experiment, start: NDArray[np.uint64]) -> NDArray[np.float64]:
    """Steering commands [rad]: (1, N) for the same register, (B, N) for random ones."""
    timing = (experiment.N, experiment.Ts, experiment.bit_time, experiment.amplitude)
    if experiment.register == "same":
        return prbs(*timing)
    return prbs(*timing, order=RANDOM_ORDER, start=start)


def simulated(task: Task, context: Context, u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Yaw rates (B, N) [rad/s] of vehicles from rest, without noise, for commands (1 or B, N)."""
    y = np.empty((len(context), u.shape[1]))
    into = task.twin.simulator(task.vehicle, context, u, task.experiment.Ts)

    def work(i: int, j: int) -> None:
        into(y[i:j], i, j)

    over_blocks(work, len(context), LANES)
    return y


def respond(
    task: Task,
    context: Context,
    u: NDArray[np.float64],
    key: NDArray[np.uint64],
    out: NDArray[np.floating] | None = None,
    written: Callable[[int, int], None] = lambda i, j: None,
) -> NDArray[np.floating]:
    """Measured yaw rates (B, N) [rad/s] of vehicles steered by (1 or B, N) [rad].

    Parameters
    ----------
    key : (B, 4) uint64
        The noise streams.
    out : (B, N) float32 or float64, optional
        Where the yaw rates go; may be a strided view.
    written : callable
        ``written(i, j)`` is called once those of vehicles i to j are there, from any thread.
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
        written(i, j)

    over_blocks(work, len(context), LANES)
    return y
