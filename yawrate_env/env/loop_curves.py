"""Curves of the loops in a picture: frequency and step responses of the gains and the oracle."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yawrate_env.batch import take
from yawrate_env.loop import closed_loop
from yawrate_env.loop.loops import Evaluation
from yawrate_env.loop.target import Target
from yawrate_env.loop.transfer_function import open_loop
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.single_track import Context, theta_of
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

DIVERGED = 5.0
"""Where the drawing of a step response ends, in steps."""


@dataclass(frozen=True, slots=True, eq=False)
class LoopCurves:
    """Two loops around one vehicle: row 0 of the gains, row 1 of the oracle."""

    kp: NDArray[np.float64]
    Ti: NDArray[np.float64]
    found: Evaluation
    reward: NDArray[np.float64]
    frequency: NDArray[np.float64]
    magnitude: NDArray[np.float64]
    phase: NDArray[np.float64]
    time: NDArray[np.float64]
    yaw_rate: NDArray[np.float64]

    @classmethod
    def of(cls, task: Task, context: Context, gains: NDArray[np.float64]) -> "LoopCurves":
        """Close both loops; frequency in Hz, magnitude in dB, angles in deg."""
        context, target = take(context, np.array([0, 0])), task.target
        around, plant = loops(task, context), yaw_rate(task, check=False)
        oracle = around.design()
        kp, Ti = np.array([gains, [oracle.kp[0], oracle.Ti[0]]]).T
        low, high = band(target)
        frequency = np.geomspace(low, 0.9999 * high, 500)  # at Nyquist itself L may be zero
        L = open_loop(around.transfer_function, kp, Ti, target)(2 * np.pi * frequency)
        angle = np.angle(L)
        angle[:, 0] -= 2 * np.pi * (angle[:, 0] > np.pi / 2)  # as the design rule follows it
        time = target.Ts * np.arange(round(duration(target) / target.Ts) + 1, dtype=np.float64)
        with np.errstate(over="ignore", invalid="ignore"):  # unstable loops may overflow
            y, _ = closed_loop.time_response(around.plant, kp, Ti, target, np.ones(len(time)))
            lost = np.maximum.accumulate(~(np.abs(y) < DIVERGED), axis=1)
        return cls(
            kp=kp,
            Ti=Ti,
            found=around.evaluate(kp, Ti),
            reward=plant.reward(theta_of(context), np.stack([kp, Ti], axis=1)),
            frequency=frequency,
            magnitude=20 * np.log10(np.abs(L)),
            phase=np.degrees(np.unwrap(angle, axis=1)),
            time=time,
            yaw_rate=np.where(lost, np.nan, y),
        )

    @property
    def stable(self) -> bool:
        """Whether the loop of the gains is."""
        return bool(self.found.stable[0])

    @property
    def oracle_label(self) -> str:
        """Name of the second loop in the legend."""
        return "oracle" if np.isfinite(self.kp[1]) else "no oracle"


def band(target: Target) -> tuple[float, float]:
    """Frequencies of the Bode plot [Hz]: 0.05 (or lower, for a slow target) to Nyquist."""
    return min(0.05, target.crossover / 20), 0.5 / target.Ts


def duration(target: Target) -> float:
    """Length of the step response [s]: 2 s for a crossover of 1.5 Hz."""
    return 3 / target.crossover
