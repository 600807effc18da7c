"""The loop of an answer around the vehicle that its fit found: what the figures show."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env import closed_loop
from yawrate_env.judge import Judge, Verdict
from yawrate_env.loop import open_loop
from yawrate_env.task import Task
from yawrate_env.vehicle import Context

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """One loop in numbers.

    Attributes
    ----------
    verdict : Verdict
        Its margins, and whether it is stable.
    frequency, magnitude, phase : NDArray
        (F,) open loop [Hz], [dB], [deg].
    time, step, command, disturbance : NDArray
        (N,) [s]; yaw rate and steering for a reference step of 1, and the yaw rate [rad/s]
        for a steering disturbance of 1 rad; ``nan`` where an unstable loop has run away.
    """

    verdict: Verdict
    frequency: Array
    magnitude: Array
    phase: Array
    time: Array
    step: Array
    command: Array
    disturbance: Array

    @classmethod
    def of(cls, task: Task, context: Context, kp: float, Ti: float) -> Self:
        """Close the loop of gains around a vehicle (a batch of one)."""
        judge, target = Judge.of(task, context), task.target
        gains = np.array([kp]), np.array([Ti])
        frequency = np.geomspace(target.crossover / 30, 0.4999 / target.Ts, 400)
        L = open_loop(judge.transfer_function, *gains, target)(2 * np.pi * frequency)[0]
        phase = np.unwrap(np.angle(L))
        phase -= 2 * np.pi * np.ceil((phase[0] - np.pi / 2) / (2 * np.pi))
        time = target.Ts * np.arange(round(4 / target.crossover / target.Ts) + 1, dtype=np.float64)
        one, zero = np.ones(len(time)), np.zeros(len(time))
        with np.errstate(over="ignore", invalid="ignore"):
            step, command = closed_loop.time_response(judge.plant, *gains, target, one)
            after, _ = closed_loop.time_response(judge.plant, *gains, target, zero, one)
        return cls(
            judge(*gains),
            frequency,
            20 * np.log10(np.abs(L)),
            np.degrees(phase),
            time,
            *(_bounded(values[0]) for values in (step, command, after)),
        )


def _bounded(values: Array, largest: float = 1e3) -> Array:
    lost = np.maximum.accumulate(~(np.abs(values) < largest))
    return np.where(lost, np.nan, values)
