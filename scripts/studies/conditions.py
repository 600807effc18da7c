"""Conditions off the design point: what is true, and what the recording shows of it.

Each is a pure function of the tuners' own task and a level.  It gives the task that
simulates, whose vehicles gains are evaluated on, and a transformation of what was
recorded.  The tuners keep their own task whatever is true.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from tuners.tuner.recording import Recording
from yawrate_env.plant.episodes import Draw
from yawrate_env.signals.noise import standard_normal
from yawrate_env.vehicle.task import Task

Array = NDArray[np.float64]
Level = float | str
Transformation = Callable[[Recording, Draw], Recording]

_NOISELESS = 200.0  # dB, where noise is added afterwards


@dataclass(frozen=True, slots=True)
class Sweep:
    """One condition at several levels.

    Attributes
    ----------
    name : str
        What is changed, and its unit.
    make : callable
        Task and level to the task that simulates and what its recordings go through.
    levels : tuple
        In the order of a figure.
    design : float or str
        The level that changes nothing, one of the levels.
    bounded : bool
        Whether the Cramer-Rao bound of the task that simulates is one for the tuners: they
        know all but friction and mass, and the noise is white.
    """

    name: str
    make: Callable[[Task, Any], tuple[Task, Transformation]]
    levels: tuple[Level, ...]
    design: Level
    bounded: bool = False


def as_recorded(recording: Recording, draw: Draw) -> Recording:
    """Change nothing."""
    return recording


def signal_to_noise(task: Task, snr_db: float) -> tuple[Task, Transformation]:
    """Another noise level [dB]."""
    return replace(task, experiment=replace(task.experiment, snr_db=snr_db)), as_recorded


def length(task: Task, seconds: float) -> tuple[Task, Transformation]:
    """Shorter or longer episodes; the noise of the shorter is the beginning of the longer's."""
    samples = round(seconds / task.experiment.Ts)
    return replace(task, experiment=replace(task.experiment, N=samples)), as_recorded


def register(task: Task, kind: str) -> tuple[Task, Transformation]:
    """The excitation that every training had, or one of its own for every episode."""
    return replace(task, experiment=replace(task.experiment, register=kind)), as_recorded


def noise_colour(task: Task, corner: Level) -> tuple[Task, Transformation]:
    """First-order noise of the same power with this corner frequency [Hz], or ``"white"``."""
    experiment, corner = task.experiment, np.inf if corner == "white" else float(corner)

    def add(recording: Recording, draw: Draw) -> Recording:
        noise = coloured(draw.keys, recording.y.shape[1], recording.Ts, corner)
        sigma = rms(recording.y) * 10 ** (-experiment.snr_db / 20)
        return replace(recording, y=recording.y + sigma * noise)

    return replace(task, experiment=replace(experiment, snr_db=_NOISELESS)), add


def coloured(keys: NDArray[np.uint64], N: int, Ts: float, corner: float) -> Array:
    """Stationary noise of variance one behind a first-order low-pass, (B, N)."""
    pole = np.exp(-2 * np.pi * corner * Ts)
    gain = np.sqrt(1 - pole**2)
    white = standard_normal(keys, N)
    # The first sample counts in full, so that the variance is one from the start.
    noise, _ = lfilter([gain], [1.0, -pole], white, axis=1, zi=(1 - gain) * white[:, :1])
    return np.asarray(noise)


def yaw_rate_bias(task: Task, share: float) -> tuple[Task, Transformation]:
    """A constant on the yaw rate, as a share of its root mean square."""

    def add(recording: Recording, draw: Draw) -> Recording:
        return replace(recording, y=recording.y + share * rms(recording.y))

    return task, add


def steering_bias(task: Task, share: float) -> tuple[Task, Transformation]:
    """A constant on the recorded command, as a share of its root mean square."""

    def add(recording: Recording, draw: Draw) -> Recording:
        return replace(recording, u=recording.u + share * rms(recording.u))

    return task, add


def parameters_off(
    task: Task, percent: float, names: tuple[str, ...]
) -> tuple[Task, Transformation]:
    """The true vehicle's `names` differ from what the tuner was made for."""
    factor = 1 + percent / 100
    true = {name: getattr(task.vehicle, name) * factor for name in names}
    return replace(task, vehicle=replace(task.vehicle, **true)), as_recorded


def speed_off(task: Task, error: float) -> tuple[Task, Transformation]:
    """The vehicle is faster than the recording claims by `error` [m/s]."""
    low, high = task.prior.v_x

    def claim(recording: Recording, draw: Draw) -> Recording:
        assert recording.known is not None
        return replace(recording, known=recording.known - [0.0, 0.0, error])

    return replace(task, prior=replace(task.prior, v_x=(low + error, high + error))), claim


def rms(values: Array) -> Array:
    """Root mean square of each row, (B, 1)."""
    return np.asarray(np.sqrt((values**2).mean(axis=1, keepdims=True)))


_BIASES: tuple[Level, ...] = (0.0, 0.03, 0.1, 0.3, 1.0)
_PERCENT: tuple[Level, ...] = (-20.0, 0.0, 20.0)
_ACTUATOR = ("omega_n",)
_TYRES = ("l_rel_f", "l_rel_r")

SPEED = Sweep(
    "true minus claimed speed [m/s]", speed_off, (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0), 0.0
)

SWEEPS = (
    Sweep("signal-to-noise ratio [dB]", signal_to_noise, (10.0, 20.0, 30.0, 40.0, 50.0), 30.0,
          bounded=True),
    Sweep("episode length [s]", length, (1.0, 2.0, 5.0, 10.0, 20.0), 10.0, bounded=True),
    Sweep("excitation register", register, ("same", "random"), "same", bounded=True),
    Sweep("corner of coloured noise [Hz]", noise_colour, ("white", 30.0, 8.0, 2.0, 0.5), "white"),
    Sweep("bias of yaw rate [its rms]", yaw_rate_bias, _BIASES, 0.0),
    Sweep("bias of steering [its rms]", steering_bias, _BIASES, 0.0),
    Sweep("yaw inertia off by [%]", partial(parameters_off, names=("J_z",)), _PERCENT, 0.0),
    Sweep("actuator bandwidth off by [%]", partial(parameters_off, names=_ACTUATOR), _PERCENT, 0.0),
    Sweep("relaxation lengths off by [%]", partial(parameters_off, names=_TYRES), _PERCENT, 0.0),
    SPEED,
)  # fmt: skip
"""The experiment, the sensors, the true vehicle against the tuner's, the speed."""
