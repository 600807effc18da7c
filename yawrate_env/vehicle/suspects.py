"""Suspects of a vehicle: what may be wrong with its data or its log, in words."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from yawrate_env.plant.suspect import Suspect, later, slowed, zeroed
from yawrate_env.vehicle.episode import simulated
from yawrate_env.vehicle.single_track import context_of
from yawrate_env.vehicle.task import Task

Array = NDArray[np.float64]

WORDS = {
    "J_z": "yaw inertia",
    "C_f": "front stiffness",
    "C_r": "rear stiffness",
    "l_f": "front axle distance",
    "l_r": "rear axle distance",
    "l_rel_f": "front relaxation length",
    "l_rel_r": "rear relaxation length",
    "omega_n": "actuator bandwidth",
    "xi": "actuator damping",
}
"""Of a vehicle's constants."""
_ABSENT = 0.15  # of a relaxation length
_LATEST = 0.25  # s
_DRIVE = "Correct the vehicle's data, or let the prior cover it."


def suspects(task: Task) -> tuple[Suspect, ...]:
    """Those of a task's vehicles."""
    vehicle, Ts = task.vehicle, task.experiment.Ts
    given = task.prior.others
    constants = [
        Suspect(
            name,
            _Constant(task, name),
            nominal := getattr(vehicle, name),
            (1e-4 if name.startswith("l_rel") else 0.4 * nominal, 2.0 * nominal),
            0.02 * nominal,
            _Changed(words, nominal),
        )
        for name, words in WORDS.items()
        if name not in given
    ]
    rate = 2.0
    return (
        *constants,
        Suspect("sensor_lag", _Constant(task, "sensor_lag"), vehicle.sensor_lag,
                (0.0, 0.3), 0.002, _lagging),
        Suspect("speed", _Speed(task), 0.0, (-8.0, 8.0), 0.2, _speed, logged=True),
        Suspect("late", _Late(task, Ts), 0.0, (-_LATEST, _LATEST), Ts, _late,
                logged=True),
        Suspect("gyro", _Gain(task), 1.0, (0.5, 2.0), 0.01, _gain, logged=True),
        Suspect("auto-zero", _HighPass(task, Ts), 0.0, (0.0, 6.0), 0.05, _zeroed, logged=True),
        Suspect("rate", _Rate(task, Ts), rate, (0.05, rate), 0.1 * rate, _rate),
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Constant:
    """Vehicles with one constant in place of the task's."""

    task: Task
    name: str

    def __call__(self, theta: Array, value: Array, u: Array) -> Array:
        context = context_of(theta, self.task.prior.others)
        others = {**context.others, self.name: value}
        return simulated(self.task, replace(context, others=others), u)


@dataclass(frozen=True, slots=True)
class _Speed:
    """Vehicles that drive faster than the log says [m/s]."""

    task: Task

    def __call__(self, theta: Array, value: Array, u: Array) -> Array:
        context = context_of(theta, self.task.prior.others)
        v_x = np.maximum(context.v_x + value, 1.0)
        return simulated(self.task, replace(context, v_x=v_x), u)


@dataclass(frozen=True, slots=True)
class _Late:
    """Yaw rates logged late [s]."""

    task: Task
    Ts: float

    def __call__(self, theta: Array, value: Array, u: Array) -> Array:
        return later(_driven(self.task, theta, u), value / self.Ts)


@dataclass(frozen=True, slots=True)
class _Gain:
    """Yaw rates times a factor."""

    task: Task

    def __call__(self, theta: Array, value: Array, u: Array) -> Array:
        return _driven(self.task, theta, u) * value[:, None]


@dataclass(frozen=True, slots=True)
class _HighPass:
    """Yaw rates without what is slower than a corner frequency [rad/s]."""

    task: Task
    Ts: float

    def __call__(self, theta: Array, value: Array, u: Array) -> Array:
        return zeroed(_driven(self.task, theta, u), np.exp(-value * self.Ts))


@dataclass(frozen=True, slots=True)
class _Rate:
    """A steering command that is followed at a limited rate [rad/s]."""

    task: Task
    Ts: float

    def __call__(self, theta: Array, value: Array, u: Array) -> Array:
        return _driven(self.task, theta, slowed(u, value * self.Ts))


@dataclass(frozen=True, slots=True)
class _Changed:
    """A constant that is larger or smaller than the vehicle's data say."""

    words: str
    nominal: float

    def __call__(self, value: float) -> str:
        share = value / self.nominal - 1
        if value <= _ABSENT * self.nominal:
            return f"The recording asks for another vehicle: {self.words} looks absent. {_DRIVE}"
        more = "larger" if share > 0 else "smaller"
        return (
            f"The recording asks for another vehicle: {self.words} about {abs(share):.0%} {more}. "
            f"{_DRIVE}"
        )


def _lagging(value: float) -> str:
    return (
        f"The yaw rate lags by about {1e3 * value:.0f} ms: is the sensor filtered? Give sensor_lag "
        "if the loop has the same sensor."
    )


def _speed(value: float) -> str:
    more = "higher" if value > 0 else "lower"
    return f"The speed looks {abs(value):.1f} m/s {more} than the log says: is its unit right?"


def _late(value: float) -> str:
    if value < 0:
        return (
            f"The yaw rate answers {-1e3 * value:.0f} ms sooner than the vehicle's data say: is "
            "the logged signal the command, at the time when it was sent?"
        )
    return (
        f"The yaw rate is late by {1e3 * value:.0f} ms: does the vehicle have that dead time, or "
        "only the log?"
    )


def _gain(value: float) -> str:
    more = "stronger" if value > 1 else "weaker"
    return (
        f"The yaw rate is {abs(value - 1):.0%} {more} than any vehicle of these data: are the "
        "sensor's scale, the steering ratio and the units right, and does the loop have them too?"
    )


def _zeroed(value: float) -> str:
    return (
        f"The yaw rate looks high-pass filtered at {value / (2 * np.pi):.2g} Hz: is the sensor "
        "AC-coupled or re-zeroed, and does the loop have that too?"
    )


def _rate(value: float) -> str:
    return f"The steering looks rate-limited at {value:.2g} rad/s: excite with smaller steps."


def _driven(task: Task, theta: Array, u: Array) -> Array:
    """Yaw rates (B, N) of a task's vehicles (B, p) for commands (1 or B, N)."""
    return simulated(task, context_of(theta, task.prior.others), u)
