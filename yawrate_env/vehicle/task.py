"""Settings of the yaw-rate task: prior, experiment, loop target, vehicle and twin.

The defaults are the paper's values, and our choices where the paper is silent: the
speed, the excitation, and 1 kHz episodes for a controller that runs at 100 Hz.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Self

import numpy as np

from yawrate_env import validation
from yawrate_env.loop.target import Target
from yawrate_env.vehicle.single_track import LARGEST, SMALLEST, Vehicle
from yawrate_env.vehicle.twin import LinearTwin, Twin

REGISTERS = ("same", "random")


@dataclass(frozen=True, slots=True)
class Prior:
    """Uniform ranges of the context, eq. (12); a range may be a point.

    Attributes
    ----------
    mu_s : tuple of float
        Friction scale.
    M_delta : tuple of float
        Extra mass [kg].
    v_x : tuple of float
        Speed [m/s]; not given in the paper.
    """

    mu_s: tuple[float, float] = (0.3, 1.1)
    M_delta: tuple[float, float] = (0.0, 300.0)
    v_x: tuple[float, float] = (20.0, 20.0)

    def __post_init__(self) -> None:
        for name, largest in LARGEST.items():
            low, high = validation.interval(name, getattr(self, name))
            validation.number(name, high, at_most=largest, remedy="Use SI units.")
            object.__setattr__(self, name, (low, high))
        for name, smallest in SMALLEST.items():
            low, _ = getattr(self, name)
            validation.number(name, low, above=0.0, at_least=smallest,
                              remedy="Raise the low end of its range.")  # fmt: skip


@dataclass(frozen=True, slots=True)
class Experiment:
    """The identification episode.

    Attributes
    ----------
    Ts : float
        Sampling time [s].
    N : int
        Samples.
    amplitude : float
        Steering command is plus or minus this [rad].
    bit_time : float
        Time each bit is held [s].
    register : {"same", "random"}
        The same sequence in every episode, or a random start of a longer register.
    snr_db : float
        Mean square of the noise-free yaw rate over the noise variance [dB].
    """

    Ts: float = 0.001
    N: int = 10_000
    amplitude: float = float(np.radians(1.0))
    bit_time: float = 0.1
    register: str = "same"
    snr_db: float = 30.0

    def __post_init__(self) -> None:
        validation.number("Ts", self.Ts, above=0.0, remedy="Give a sampling time in seconds.")
        N = validation.count("N", self.N, at_least=2, at_most=1e7,
                             remedy="Record some 10 s.")  # fmt: skip
        object.__setattr__(self, "N", N)
        validation.number("amplitude", self.amplitude, at_least=1e-6, at_most=np.pi / 4,
                          remedy="Give it in rad.")  # fmt: skip
        validation.number("bit_time", self.bit_time, at_least=self.Ts,
                          remedy="Hold each bit for a sampling time or longer.")  # fmt: skip
        validation.number("snr_db", self.snr_db, at_least=-40.0, at_most=200.0,
                          remedy="Give a ratio of powers in dB.")  # fmt: skip
        validation.one_of("register", self.register, REGISTERS)
        if self.N * self.Ts < 2 * self.bit_time * (1 - 1e-9):
            raise ValueError(
                f"N = {self.N} samples of Ts = {self.Ts:g} s last {self.N * self.Ts:g} s, less "
                f"than two bits of {self.bit_time:g} s. Raise N or shorten bit_time."
            )


@dataclass(frozen=True, slots=True)
class Task:
    """A family of vehicles, how they are recorded, and what their loops must do.

    The twin drives the recorded episodes; loops are judged on the linear vehicle, which is
    every twin's linearisation about straight driving.
    """

    vehicle: Vehicle = field(default_factory=Vehicle)
    prior: Prior = field(default_factory=Prior)
    experiment: Experiment = field(default_factory=Experiment)
    target: Target = field(default_factory=Target)
    twin: Twin = field(default_factory=LinearTwin)

    def __post_init__(self) -> None:
        validation.number(
            "total mass M_0 + M_delta",
            self.vehicle.M_0 + self.prior.M_delta[0],
            above=0.0,
            remedy="Raise M_0 or the low end of M_delta.",
        )

    def settings(self) -> dict[str, Any]:
        """The task as plain JSON values."""
        return asdict(self)

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> Self:
        """Rebuild the task that `settings` wrote."""
        return cls(
            Vehicle(**settings["vehicle"]),
            Prior(**{name: tuple(values) for name, values in settings["prior"].items()}),
            Experiment(**settings["experiment"]),
            Target(**settings["target"]),
            twin=twin_from(settings.get("twin", {})),
        )


def twin_from(parameters: Mapping[str, Any]) -> Twin:
    """The twin whose ``dataclasses.asdict`` these are; without parameters the linear one."""
    if not parameters:
        return LinearTwin()
    from yawrate_env.vehicle.nonlinear.twin import NonlinearTwin

    return NonlinearTwin.of(**parameters)
