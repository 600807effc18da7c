"""Target of a loop: phase margin, crossover, and the controller's form."""

from dataclasses import dataclass

import numpy as np

from yawrate_env import validation

CONTROLLERS = ("pi", "printed")

FASTEST = 1e-5
"""Sampling time, in periods of the crossover: responses are simulated over some periods."""


@dataclass(frozen=True, slots=True)
class Target:
    """Phase margin and crossover that a loop must reach, and the controller's form.

    Attributes
    ----------
    phase_margin : float
        Wanted phase_margin [deg].
    crossover : float
        Wanted gain crossover [Hz].
    Ts : float
        Sampling time of the controller and of the plant that it sees [s].
    delay_samples : int
        Computation delay, in whole samples of `Ts`.
    controller : {"pi", "printed"}
        The Tustin PI, or eq. (13) as printed, which is a first-order lag.
    """

    phase_margin: float = 60.0
    crossover: float = 1.5
    Ts: float = 0.01
    delay_samples: int = 0
    controller: str = "pi"

    def __post_init__(self) -> None:
        validation.number("Ts_control", self.Ts, above=0.0, remedy="Give it in seconds.")
        validation.number("phase_margin", self.phase_margin, above=0.0, at_most=180.0,
                          remedy="Give it in degrees.")  # fmt: skip
        validation.number("crossover", self.crossover, above=0.0, at_most=0.45 / self.Ts,
                          remedy="Keep it, in Hz, well below half the sampling rate.")  # fmt: skip
        validation.number("Ts_control", self.Ts, at_least=FASTEST / self.crossover,
                          remedy="Take 100,000 samples a period at most.")  # fmt: skip
        delay_samples = validation.count("delay_samples", self.delay_samples, at_least=0,
                                         at_most=200, remedy="Raise Ts_control.")  # fmt: skip
        object.__setattr__(self, "delay_samples", delay_samples)
        validation.one_of("controller", self.controller, CONTROLLERS)

    @property
    def omega_c(self) -> float:
        """Wanted gain crossover [rad/s]."""
        return 2 * np.pi * self.crossover
