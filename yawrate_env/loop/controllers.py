"""Controllers by name: their gains, and the compensator that they are when sampled.

==============  =======================  ====================================================
name            gains                    u
==============  =======================  ====================================================
P               kp                       kp e
I               Ki                       Ki/s e
PI              kp, Ti                   kp (1 + 1/(Ti s)) e
PD, PDF         kp, Td[, Tf]             kp (1 + Td s/(1 + Tf s)) e
PID, PIDF       kp, Ti, Td[, Tf]         kp (1 + 1/(Ti s) + Td s/(1 + Tf s)) e
PI-D            kp, Ti, Td, Tf           kp ((1 + 1/(Ti s)) e - Td s/(1 + Tf s) y)
2DOF            kp, Ti, Td, Tf, b        kp (b r - y + 1/(Ti s) e - Td s/(1 + Tf s) y)
lead-lag        kp, T_lead, T_lag        kp (1 + T_lead s)/(1 + T_lag s) e
state feedback  k1, ..., kn, kr          kr r - k1 x1 - ... - kn xn
==============  =======================  ====================================================

with ``e = r - y``.  Tustin's formula ``s = 2/Ts (z - 1)/(z + 1)`` makes them digital.  PD and PID
have the filter ``Tf = Ts/2``, with which the derivative is a backward difference.  Rules choose
the gain kr of a state feedback so that the steady output is the reference.

All but the last (`yawrate_env.loop.state_feedback`) have the form of `yawrate_env.loop.parallel`,
``u = Kp (b r - y) + Ki/s e + Kd s/(1 + Tf s) (c r - y)``.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop import controller
from yawrate_env.loop.design import design_from_response
from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.feedback import Feedback
from yawrate_env.loop.law import KINDS, Status, filter_time, supply
from yawrate_env.loop.parallel import Parallel
from yawrate_env.loop.shaping import lead_lag
from yawrate_env.loop.target import Target
from yawrate_env.loop.transfer_function import TransferFunction

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_OF_PROCESSES = "simc", "lambda", "imc", "amigo"
_KINDS = {"PI-D": "PIDF", "2DOF": "PIDF"}  # whose loops are another's


class Controller(Protocol):
    """What loops ask of a controller."""

    @property
    def name(self) -> str:
        """Its name in the table of this module."""

    @property
    def gains(self) -> tuple[str, ...]:
        """Names of its k gains."""

    @property
    def coordinates(self) -> tuple[str, ...]:
        """What learners predict of each gain: ``log``, ``linear`` or ``signed``."""

    @property
    def rules(self) -> tuple[str, ...]:
        """Names of the design rules that are for it."""

    def usable(self, gains: Array) -> Flags:
        """Whether gains (B, k) are a controller, (B,)."""

    def shape(
        self, log_magnitude: Array, phase: Array, target: Target
    ) -> tuple[Array, NDArray[np.int64]]:
        """Gains (B, k) with responses (B,) [log 1, rad] at the target's crossover; a `Status`."""

    def open_loop(self, plant: DiscretePlant, gains: Array, delay_samples: int) -> TransferFunction:
        """Open loops of gains (B, k) around plants that are sampled as the controller is."""

    def close(self, plant: DiscretePlant, gains: Array, delay_samples: int) -> Feedback:
        """The loops closed."""


class _OfOutput:
    """Loops of controllers that see the output alone and have a parallel form."""

    __slots__ = ()

    def parallel(self, gains: Array, Ts: float) -> Parallel:
        """Gains (B, k) in the parallel form; a filter of ``Ts/2`` where they have none."""
        raise NotImplementedError

    def open_loop(self, plant: DiscretePlant, gains: Array, delay_samples: int) -> TransferFunction:
        """As `Controller` says."""
        made = self.parallel(gains, plant.Ts).compensator(plant.Ts)
        return made.around(TransferFunction.of(plant, delay_samples))

    def close(self, plant: DiscretePlant, gains: Array, delay_samples: int) -> Feedback:
        """As `Controller` says."""
        made = self.parallel(gains, plant.Ts).compensator(plant.Ts)
        return Feedback.of(plant, made, delay_samples)


@dataclass(frozen=True, slots=True)
class PID(_OfOutput):
    """A controller of the PID's family.

    Attributes
    ----------
    name : str
    gains : tuple of str
        Its gains, of kp, Ti, Td, Tf and b.
    of_error : bool
        Whether its derivative is the error's; the output's otherwise.
    """

    name: str
    gains: tuple[str, ...]
    of_error: bool = True

    @property
    def integrates(self) -> bool:
        """Whether it has an integral part."""
        return bool({"Ti", "Ki"} & set(self.gains))

    @property
    def derives(self) -> bool:
        """Whether it has a derivative part."""
        return "Td" in self.gains

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Logarithms; b itself."""
        return tuple("linear" if name == "b" else "log" for name in self.gains)

    @property
    def rules(self) -> tuple[str, ...]:
        """Rules for processes, and a largest sensitivity, where there are kp and Ti."""
        standard = (*_OF_PROCESSES, "ms") if "Ti" in self.gains else ()
        return ("loop-shaping", *standard)

    def usable(self, gains: Array) -> Flags:
        """Gains that are finite and positive; b may be 0."""
        least = np.array([-1e-300 if name == "b" else 0.0 for name in self.gains])
        return np.asarray((np.isfinite(gains) & (gains > least)).all(axis=1))

    def parallel(self, gains: Array, Ts: float) -> Parallel:
        """As `_OfOutput` says."""
        of, one = dict(zip(self.gains, gains.T, strict=True)), np.ones(len(gains))
        kp = of.get("kp", 0 * one)
        Ki = kp / of["Ti"] if "Ti" in of else of.get("Ki", 0 * one)
        Kd = kp * of.get("Td", 0 * one)
        Tf, b, c = of.get("Tf", Ts / 2 * one), of.get("b", one), float(self.of_error) * one
        return Parallel(kp, Ki, Kd, Tf, b, c, self.integrates, self.derives)

    def shape(
        self, log_magnitude: Array, phase: Array, target: Target
    ) -> tuple[Array, NDArray[np.int64]]:
        """As `Controller` says, by rule R (`yawrate_env.loop.law`)."""
        omega, kind = controller.warped(target), KINDS[_KINDS.get(self.name, self.name)]
        Tf = filter_time(kind, omega, target.Ts)
        spare = np.pi - np.radians(target.phase_margin)
        found, status = supply(kind, log_magnitude, phase, omega, Tf, spare)
        Kp, Ki, Kd = found.gains()
        one = np.ones_like(Kp)
        with np.errstate(divide="ignore", invalid="ignore"):
            of = {"kp": Kp, "Ki": Ki, "Ti": Kp / Ki, "Td": Kd / Kp, "Tf": Tf * one, "b": one}
        return self.pick(of), status

    def pick(self, standard: Mapping[str, Array]) -> Array:
        """Gains (B, k) of those that a rule gives, by name."""
        return np.stack([standard[name] for name in self.gains], axis=1)


@dataclass(frozen=True, slots=True)
class LeadLag(_OfOutput):
    """A lead or a lag, ``kp (1 + T_lead s)/(1 + T_lag s)``: a PD with a filter, of either sign."""

    name: str = "lead-lag"
    gains: tuple[str, ...] = ("kp", "T_lead", "T_lag")
    integrates: bool = False
    derives: bool = True

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Logarithms."""
        return ("log",) * len(self.gains)

    @property
    def rules(self) -> tuple[str, ...]:
        """Loop shaping."""
        return ("loop-shaping",)

    def usable(self, gains: Array) -> Flags:
        """Gains that are finite and positive."""
        return np.asarray((np.isfinite(gains) & (gains > 0)).all(axis=1))

    def shape(
        self, log_magnitude: Array, phase: Array, target: Target
    ) -> tuple[Array, NDArray[np.int64]]:
        """As `Controller` says; centred at the crossover."""
        gains = lead_lag(log_magnitude, phase, controller.warped(target))
        found = np.isfinite(gains).all(axis=1)
        return gains, np.where(found, Status.OK, Status.UNREACHABLE).astype(np.int64)

    def parallel(self, gains: Array, Ts: float) -> Parallel:
        """As `_OfOutput` says."""
        kp, lead, lag = gains.T
        one = np.ones_like(kp)
        return Parallel(kp, 0 * one, kp * (lead - lag), lag, one, one, False, True)


@dataclass(frozen=True, slots=True)
class Printed(_OfOutput):
    """Eq. (13) of the paper as printed, ``kp/(1 + Ti s)``: a first-order lag."""

    name: str = "printed"
    gains: tuple[str, ...] = ("kp", "Ti")
    coordinates: tuple[str, ...] = ("log", "log")
    rules: tuple[str, ...] = ("loop-shaping",)

    def usable(self, gains: Array) -> Flags:
        """Gains that are finite and positive."""
        return np.asarray((np.isfinite(gains) & (gains > 0)).all(axis=1))

    def parallel(self, gains: Array, Ts: float) -> Parallel:
        """As `_OfOutput` says."""
        kp, Ti = gains.T
        one = np.ones_like(kp)
        return Parallel(kp, 0 * one, -kp * Ti, Ti, one, one, False, True)

    def shape(
        self, log_magnitude: Array, phase: Array, target: Target
    ) -> tuple[Array, NDArray[np.int64]]:
        """As `Controller` says."""
        found = design_from_response(log_magnitude, phase, target)
        return np.stack([found.kp, found.Ti], axis=1), found.status


CONTROLLERS: dict[str, PID | LeadLag] = {
    "P": PID("P", ("kp",)),
    "I": PID("I", ("Ki",)),
    "PI": PID("PI", ("kp", "Ti")),
    "PD": PID("PD", ("kp", "Td")),
    "PDF": PID("PDF", ("kp", "Td", "Tf")),
    "PID": PID("PID", ("kp", "Ti", "Td")),
    "PIDF": PID("PIDF", ("kp", "Ti", "Td", "Tf")),
    "PI-D": PID("PI-D", ("kp", "Ti", "Td", "Tf"), of_error=False),
    "2DOF": PID("2DOF", ("kp", "Ti", "Td", "Tf", "b"), of_error=False),
    "lead-lag": LeadLag(),
}
"""Those with the same gains for every plant."""


def of_target(target: Target) -> PID | LeadLag | Printed:
    """The controller of a target: the PI, or its printed form."""
    return CONTROLLERS["PI"] if target.controller == "pi" else Printed()
