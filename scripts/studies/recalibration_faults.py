"""What a filter does not know of the cars, their noise and their roads, one fault after another."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from yawrate_env.loop.target import Target
from yawrate_env.vehicle.drive_conditions import Conditions, Window
from yawrate_env.vehicle.drives import Course, Drives
from yawrate_env.vehicle.single_track import Vehicle

Array = NDArray[np.float64]

_WINDOWS = 50  # of a drive
_COLOUR = 0.9  # share of coloured noise that stays from sample to sample


def _same(window: Window) -> Window:
    return window


@dataclass(frozen=True, slots=True, eq=False)
class Fault:
    """How drives differ from what is assumed of them.

    Attributes
    ----------
    factors : mapping
        Of the vehicle's constants.
    conditions : mapping
        Instead of those assumed.
    gain : float
        Of the yaw-rate sensor.
    delay : int
        Samples by which commands are late.
    falls : float
        Share of the front stiffness that is lost from the first window to the last.
    loads : bool
        Whether the load becomes another one in the middle of the drive.
    window : callable
        What else windows meet.
    """

    factors: Mapping[str, float] = field(default_factory=dict)
    conditions: Mapping[str, float] = field(default_factory=dict)
    gain: float = 1.0
    delay: int = 0
    falls: float = 0.0
    loads: bool = False
    window: Callable[[Window], Window] = _same

    def of(self, assumed: Drives) -> Drives:
        """Drives with the fault, read by the estimator of those that are assumed."""
        constants = {name: k * getattr(Vehicle(), name) for name, k in self.factors.items()}
        conditions = replace(assumed.conditions, **dict[str, Any](self.conditions))
        target = Target(Ts=conditions.Ts, delay_samples=self.delay)
        true = Drives.of(replace(Vehicle(), **constants), conditions, target)
        return replace(true, estimator=assumed.estimator, gain=self.gain)

    def drives(self, drives: Drives, t: int) -> Drives:
        """The drives in window t."""
        if not self.falls:
            return drives
        vehicle = drives.vehicle
        return replace(drives, vehicle=replace(
            vehicle, C_f=vehicle.C_f * (1 - self.falls * t / (_WINDOWS - 1))))  # fmt: skip

    def course(self, course: Course, t: int) -> Course:
        """The course before window t."""
        if not self.loads or t != _WINDOWS // 2:
            return course
        low, high = Conditions().M_delta
        theta = course.theta.copy()
        theta[:, 1] = low + high - theta[:, 1]
        return replace(course, theta=theta)


def _offset(window: Window) -> Window:
    """A gyro that shows 0.3 deg/s too much."""
    return replace(window, noise=window.noise + np.radians(0.3))


def _coloured(window: Window) -> Window:
    """Gyro noise of the same size that changes slowly."""
    fresh = np.sqrt(1 - _COLOUR**2)
    return replace(window, noise=lfilter([fresh], [1, -_COLOUR], window.noise, axis=1))


def _half_coloured(window: Window) -> Window:
    """Gyro noise of the same size, half of whose energy changes slowly."""
    slow = _coloured(replace(window, noise=np.roll(window.noise, 1, axis=0))).noise
    return replace(window, noise=np.sqrt(0.5) * (window.noise + slow))


def _sloping(window: Window) -> Window:
    """A road that pulls to one side, as 0.1 deg of steering do, twice what the disturbance is."""
    return replace(window, white=window.white + 0.366)


def _gusty(window: Window) -> Window:
    """One sample in a hundred of the gyro is off by a degree a second."""
    N = window.noise.shape[1]
    noise = window.noise.copy()
    noise[:, N // 4 :: 100] += np.radians(1.0)
    return replace(window, noise=noise)


def _constants() -> dict[str, Fault]:
    names = {
        "C_f": "front stiffness",
        "C_r": "rear stiffness",
        "J_z": "yaw inertia",
        "l_f": "front axle distance",
        "l_r": "rear axle distance",
        "l_rel_f": "front relaxation length",
        "l_rel_r": "rear relaxation length",
        "omega_n": "actuator bandwidth",
        "xi": "actuator damping",
        "M_0": "mass",
    }
    return {f"{words} {sign} 10 %": Fault({name: factor}) for name, words in names.items()
            for sign, factor in (("−", 0.9), ("+", 1.1))}  # fmt: skip


FAULTS: dict[str, Fault] = {
    "as assumed": Fault(),
    **_constants(),
    "front stiffness − 10 %, inertia + 10 %": Fault({"C_f": 0.9, "J_z": 1.1}),
    "actuator − 10 %, front stiffness + 10 %": Fault({"omega_n": 0.9, "C_f": 1.1}),
    "relaxation − 20 %, damping + 20 %": Fault({"l_rel_f": 0.8, "xi": 1.2}),
    "gyro gain + 10 %": Fault(gain=1.1),
    "gyro gain − 10 %": Fault(gain=0.9),
    "gyro offset 0.3 deg/s": Fault(window=_offset),
    "dead time 20 ms": Fault(delay=2),
    "no disturbance": Fault(conditions={"disturbance": 0.0}),
    "disturbance × 2": Fault(conditions={"disturbance": float(np.radians(0.1))}),
    "disturbance 5 times faster": Fault(conditions={"disturbance_time": 0.03}),
    "disturbance 4 times slower": Fault(conditions={"disturbance_time": 0.6}),
    "gyro noise × 2": Fault(conditions={"noise": float(np.radians(0.2))}),
    "gyro noise × 0.5": Fault(conditions={"noise": float(np.radians(0.05))}),
    "gyro noise × 2, front stiffness − 10 %": Fault(
        {"C_f": 0.9}, {"noise": float(np.radians(0.2))}
    ),
    "half of the gyro noise coloured": Fault(window=_half_coloured),
    "all of the gyro noise coloured": Fault(window=_coloured),
    "outliers of the gyro": Fault(window=_gusty),
    "sloping road": Fault(window=_sloping),
    "another load in mid-drive": Fault(loads=True),
    "front stiffness falls by 15 %": Fault(falls=0.15),
}
"""What is not as assumed."""
