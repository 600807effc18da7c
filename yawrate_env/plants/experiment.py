"""The experiment that a ready plant is recorded in."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.signals.excitation import RANDOM_ORDER, SAME_ORDER, multilevel, multisine, prbs

Array = NDArray[np.float64]

KINDS = "prbs", "multisine"


@dataclass(frozen=True, slots=True)
class Experiment:
    """A test of a process.

    Attributes
    ----------
    Ts, N : float, int
        Sampling time [s], also of the controller, and number of samples.
    kind : {"prbs", "multisine"}
        Levels that are held, or a sum of sines (`yawrate_env.signals.excitation`).
    amplitude : float
        Largest absolute input: half the difference of two levels.
    bit_time : float
        How long a level is held at least [s]; sines have frequencies up to ``0.44/bit_time``.
    levels : int
        Of a ``prbs``; two show no saturation and no characteristic of the actuator.
    order : int, optional
        Length of the shift register of a ``prbs``, 2 to 20; 7 for two levels and 14 for more if
        omitted.
    noise : float
        Standard deviation of the measurement noise, in the output's unit.
    signals : tuple of str
        Names of input and output, with units in brackets.
    """

    Ts: float = 1.0
    N: int = 600
    amplitude: float = 1.0
    bit_time: float = 20.0
    kind: str = "prbs"
    levels: int = 2
    order: int | None = None
    noise: float = 0.05
    signals: tuple[str, str] = ("u", "y")

    def __post_init__(self) -> None:
        for name in ("Ts", "amplitude", "bit_time"):
            validation.number(name, getattr(self, name), above=0.0, remedy="Give a positive one.")
        object.__setattr__(self, "N", validation.count("N", self.N, remedy="Record some samples."))
        validation.one_of("kind", self.kind, KINDS)
        validation.count("levels", self.levels, at_least=2, remedy="Two are the fewest.")
        if self.kind == "multisine" and self.levels != 2:
            raise ValueError(f"levels = {self.levels}: a multisine has none. Leave one out.")
        names, remedy = self.signals, 'Name input and output, as in ["heater [%]", "level [cm]"].'
        if not isinstance(names, list | tuple) or len(names) != 2:
            raise ValueError(f"signals = {names!r} are not two names. {remedy}")
        for name in names:
            validation.text("signal", name, remedy=remedy)
        object.__setattr__(self, "signals", tuple(names))

    def changed(self, given: "Given") -> "Experiment":
        """The experiment that is given, or this one with the settings of a mapping."""
        if not isinstance(given, Mapping):
            return validation.instance(
                "experiment", given, Experiment, remedy="Give an Experiment."
            )
        for name in given:
            validation.one_of("experiment's setting", name, self.__slots__)
        return replace(self, **given)

    def input(self) -> Array:
        """What is applied, (N,)."""
        timing = self.N, self.Ts, self.bit_time, self.amplitude
        if self.kind == "multisine":
            u = multisine(*timing)
        elif self.levels > 2:
            u = multilevel(*timing, self.levels, order=self.order or RANDOM_ORDER)
        else:
            u = prbs(*timing, order=self.order or SAME_ORDER)
        if self.N > 1 and np.ptp(u[0]) == 0:
            raise ValueError(
                f"bit_time = {self.bit_time:g} s is too long: the input does not change within "
                f"{self.N * self.Ts:g} s. Give a shorter one, or more samples N."
            )
        return np.asarray(u[0])


Given = Experiment | Mapping[str, Any]
USUAL: Mapping[str, Any] = MappingProxyType({})
"""No setting other than the plant's usual ones."""
