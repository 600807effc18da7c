"""Drives with faults: what is true, what acts, what is measured, and what is logged.

A `Fault` is steps at three stages of a recording, and two faults add up.  Vehicles may change
on the way.  Gains are judged with the vehicles as they start, by loops that are linear: what
bends or sticks at the recording's amplitude is not in them.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from studies import faulty
from studies.faulty import Array, Faulty, Rng, claimed_speed, strength
from tuners.tuner.recording import Recording
from yawrate_env.vehicle.episode import plants
from yawrate_env.vehicle.single_track import N_STATES, Context
from yawrate_env.vehicle.task import Task


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """B drives, as far as they have been recorded.

    Attributes
    ----------
    task : Task
        What the tuner was made for, and the experiment.
    context : Context
        True vehicles, at the start.
    later : tuple of (int, Context)
        Samples from which on they are others, in order.
    u : NDArray
        (B, N) command, as the log has it [rad].
    applied : NDArray
        (B, N) command, as the actuator gets it [rad].
    y : NDArray
        (B, N) yaw rate [rad/s]; zero before the drive.
    sigma : NDArray
        (B, 1) standard deviation of the noise [rad/s]; zero before the drive.
    v_x : NDArray
        (B,) speed, as the log has it [m/s].
    gain : NDArray
        (B,) of the yaw-rate sensor, in the loop too.
    """

    task: Task
    context: Context
    later: tuple[tuple[int, Context], ...]
    u: Array
    applied: Array
    y: Array
    sigma: Array
    v_x: Array
    gain: Array

    def __len__(self) -> int:
        return len(self.y)

    @property
    def shape(self) -> tuple[int, int]:
        """B, N."""
        return self.y.shape[0], self.y.shape[1]

    @property
    def rms(self) -> Array:
        """Strength of the yaw rate (B, 1) [rad/s]."""
        return strength(self.y)

    @property
    def peak(self) -> Array:
        """Largest yaw rate (B, 1) [rad/s]."""
        return np.asarray(np.abs(self.y).max(axis=1, keepdims=True))


Step = Callable[[Drive, Rng], Drive]
Steps = tuple[Step, ...]


@dataclass(frozen=True, slots=True)
class Fault:
    """Steps at the stages of a recording.

    Attributes
    ----------
    vehicle : tuple
        Before the drive: vehicle, command and what is claimed.
    signal : tuple
        On the yaw rate without its noise.
    log : tuple
        On the log, noise included.
    """

    vehicle: Steps = ()
    signal: Steps = ()
    log: Steps = ()

    def __add__(self, other: "Fault") -> "Fault":
        return Fault(self.vehicle + other.vehicle, self.signal + other.signal, self.log + other.log)


def record(fault: Fault, task: Task, rng: Rng, count: int) -> Faulty:
    """Recordings of `count` vehicles of the prior with a fault."""
    context = faulty.of_prior(task, rng, count)
    u = faulty.commands(task, rng, count)
    nothing = np.zeros((count, 1))
    drive = Drive(
        task, context, (), u, u, np.zeros_like(u), nothing, context.v_x, np.ones(count)
    )  # fmt: skip
    drive = _followed(drive, fault.vehicle, rng)
    y = driven(drive) * drive.gain[:, None]
    drive = replace(drive, y=y, sigma=faulty.deviation(task, y))
    drive = _followed(drive, fault.signal, rng)
    noisy = drive.y + drive.sigma * rng.standard_normal(drive.shape)
    drive = _followed(replace(drive, y=noisy), fault.log, rng)
    same = (drive.u == drive.u[0]).all()
    inputs = np.ascontiguousarray(drive.u[:1] if same else drive.u)
    known = claimed_speed(drive.v_x)
    recording = Recording(inputs, np.ascontiguousarray(drive.y), task.experiment.Ts, known)
    return Faulty(recording, drive.context, gain=drive.gain)


def driven(drive: Drive) -> Array:
    """Noise-free yaw rates (B, N) from rest, of vehicles that may change on the way."""
    if not drive.later:
        return faulty.driven(drive.task, drive.context, drive.applied)
    B, N = drive.shape
    y, states, first = np.empty((B, N)), np.zeros((B, N_STATES)), 0
    ends = [*(start for start, _ in drive.later), N]
    contexts = [drive.context, *(context for _, context in drive.later)]
    for context, end in zip(contexts, ends, strict=True):
        plant = plants(drive.task.vehicle, context, drive.task.experiment.Ts)
        if plant.delay is not None:
            raise ValueError("dead_time: vehicles that change on the way have none.")
        for k in range(first, end):
            y[:, k] = states @ plant.C
            states = (plant.A @ states[..., None])[..., 0] + plant.B * drive.applied[:, k, None]
        first = end
    return y


def _followed(drive: Drive, steps: Steps, rng: Rng) -> Drive:
    for step in steps:
        drive = step(drive, rng)
    return drive
