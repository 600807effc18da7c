"""Settings of the yaw-rate task: prior, experiment, loop target, vehicle and twin.

The defaults are the paper's values, and our choices where the paper is silent: the
speed, the excitation, and 1 kHz episodes for a controller that runs at 100 Hz.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Self

import numpy as np

from yawrate_env import validation
from yawrate_env.loop.target import Target
from yawrate_env.plant.distributions import Shape, Spread, spread
from yawrate_env.vehicle.single_track import CONTEXT, OTHERS, Vehicle, check_parameter
from yawrate_env.vehicle.twin import LinearTwin, Twin

REGISTERS = ("same", "random")

SLOWEST = 0.1
"""Speed [m/s]."""

LIGHTEST = 0.1
"""Total mass, in parts of the vehicle's own."""

MOST_SAMPLES = 200_000
"""Of an episode; as many as a tuner takes."""


@dataclass(frozen=True, slots=True)
class Prior:
    """What differs from vehicle to vehicle: friction, mass and speed, eq. (12), and any other.

    Each is a range ``(low, high)`` with a uniform distribution, a number, or a `LogRange` or
    `Normal` of `yawrate_env.plant`.  All but the first three are the vehicle's own constants
    where they are None.  Only ratios of stiffness, mass and inertia show in a recording: of
    friction, mass and inertia, and of friction and the two stiffnesses, one must be a number
    for the others to be found.

    Attributes
    ----------
    mu_s : tuple of float
        Friction scale.
    M_delta : tuple of float
        Extra mass [kg].
    v_x : tuple of float
        Speed [m/s]; not given in the paper.
    J_z, l_f, l_r, C_f, C_r, l_rel_f, l_rel_r, omega_n, xi, dead_time, sensor_lag : optional
        As in `Vehicle`.
    """

    mu_s: Spread = (0.3, 1.1)
    M_delta: Spread = (0.0, 300.0)
    v_x: Spread = (20.0, 20.0)
    J_z: Spread | None = None
    l_f: Spread | None = None
    l_r: Spread | None = None
    C_f: Spread | None = None
    C_r: Spread | None = None
    l_rel_f: Spread | None = None
    l_rel_r: Spread | None = None
    omega_n: Spread | None = None
    xi: Spread | None = None
    dead_time: Spread | None = None
    sensor_lag: Spread | None = None

    def __post_init__(self) -> None:
        for name in (each.name for each in fields(self)):
            if name in CONTEXT or getattr(self, name) is not None:
                found = spread(name, getattr(self, name))
                object.__setattr__(self, name, found)
                for end in found:
                    check_parameter(name, end, "Use SI units, and a range within this bound.")
        validation.number("v_x", min(self.v_x), at_least=SLOWEST, remedy="Use m/s: a vehicle at "
                          "rest has no yaw response.")  # fmt: skip

    @property
    def others(self) -> tuple[str, ...]:
        """Names of parameters beside friction, mass and speed."""
        return tuple(name for name in OTHERS if getattr(self, name) is not None)

    @property
    def ranges(self) -> dict[str, Shape]:
        """All by name, in the order of a plant's parameters."""
        return {name: getattr(self, name) for name in (*CONTEXT, *self.others)}


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
        N = validation.count("N", self.N, at_least=2, at_most=MOST_SAMPLES,
                             remedy="Record some 10 s.")  # fmt: skip
        object.__setattr__(self, "N", N)
        validation.number("amplitude", self.amplitude, at_least=1e-6, at_most=np.pi / 4,
                          remedy="Give it in rad.")  # fmt: skip
        validation.number("bit_time", self.bit_time, at_least=self.Ts,
                          remedy="Hold each bit for a sampling time or longer.")  # fmt: skip
        validation.number("snr_db", self.snr_db, at_least=-20.0, at_most=200.0,
                          remedy="Give a ratio of powers in dB: noise a hundred times the yaw "
                          "rate's power hides it.")  # fmt: skip
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
            self.vehicle.M_0 + min(self.prior.M_delta),
            at_least=LIGHTEST * self.vehicle.M_0,
            remedy="Raise the low end of M_delta: a tenth of M_0 must remain.",
        )
        self.twin.check(self.vehicle, self.prior.others)

    def settings(self) -> dict[str, Any]:
        """The task as plain JSON values, without delays and priors that it does not have."""
        known = {name: value for name, value in asdict(self.vehicle).items() if value != 0}
        prior = {name: each.plain for name, each in self.prior.ranges.items()}
        parts = {name: asdict(getattr(self, name)) for name in ("experiment", "target", "twin")}
        return {"vehicle": known, "prior": prior, **parts}

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> Self:
        """Rebuild the task that `settings` wrote."""
        return cls(
            Vehicle(**settings["vehicle"]),
            Prior(**settings["prior"]),
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
