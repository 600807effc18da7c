"""The plant behind an answer as its controller sees it, and what may be moved of the loop."""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tuners.tuner.method import Rung
from tuners.tuner.result import Result
from yawrate_env.loop.controllers import CONTROLLERS
from yawrate_env.loop.state_feedback import STATE_FEEDBACK
from yawrate_env.loop.transfer_function import TransferFunction
from yawrate_env.plant.responses import OpenLoop
from yawrate_env.plant.sliders import Choice, Sliders

Array = NDArray[np.float64]

SLOWEST, FASTEST = 0.4, 2.5
"""Crossovers that rule R is asked for, in the target's."""

_HANDMADE = "PI", "P", "PID", "PIDF", "lead-lag"  # for plants that tell nothing of their rule


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """The plant behind an answer.

    Attributes
    ----------
    sliders : Sliders
        What may be moved.
    omega : NDArray
        (F,) [rad/s].
    log_responses : NDArray
        (q, F) complex128 of the signals that the controller sees: log magnitude, and phase [rad]
        without jumps; the computation delay is not in them.
    pulse : NDArray
        (K,) output for an input of one for one sample.
    pulses : NDArray, optional
        (q, K) of the signals that the controller sees, where these are not the output.
    crossover : float
        Of the answer's loop [Hz]; the target's where the loop has none.
    """

    sliders: Sliders
    omega: Array
    log_responses: NDArray[np.complex128]
    pulse: Array
    pulses: Array | None
    crossover: float

    @classmethod
    def behind(cls, result: Result) -> Self | None:
        """The model of a result; None where there is nothing to move."""
        loop, sliders = result.loop, _sliders(result)
        if sliders is None or loop is None or loop.open is None:
            return None
        drawn, target, pulse = loop.open, sliders.target, loop.open.pulse
        if pulse is None:
            return None
        omega, pulses = 2 * np.pi * drawn.frequency, None
        if sliders.states is None:
            responses = _plant(drawn, result, sliders)[None]
        else:
            responses, pulses = sliders.states(omega, len(pulse))
        phase = np.unwrap(np.angle(responses), axis=1)
        phase -= 2 * np.pi * (phase[:, :1] > np.pi / 2)  # as rule R follows it from low frequency
        found = float(drawn.marked.crossover[0])
        crossover = found if np.isfinite(found) and not sliders.shaped else target.crossover
        return cls(sliders, omega, np.log(np.abs(responses)) + 1j * phase, pulse, pulses, crossover)

    @property
    def range(self) -> tuple[float, float]:
        """Slowest and fastest crossover that rule R is asked for [Hz]."""
        target = self.sliders.target
        highest = min(FASTEST * target.crossover, 0.45 / target.Ts)
        lowest = max(SLOWEST * target.crossover, self.omega[0] / (2 * np.pi))
        return lowest, float(min(highest, 0.9 * self.omega[-1] / (2 * np.pi)))


def _sliders(result: Result) -> Sliders | None:
    """What the plant says may be moved; of others rule R, where they have a PI loop."""
    plant, target = result.plant, result.plant.loop_target
    aimed = plant.parametrisation.target
    if not plant.linear or plant.loop is None or (aimed and aimed.controller != "pi"):
        return None
    if plant.sliders is not None and plant.controller in (*CONTROLLERS, STATE_FEEDBACK, ""):
        if result.rung >= Rung.BLACK_BOX:  # rule R alone, and nothing tells the poles
            middle = np.array([(low + high) / 2 for low, high in plant.prior.values()])
            return replace(plant.sliders(middle), unstable=None, integrators=None)
        return plant.sliders(np.array(list(result.fit.parameters.values())))
    if target is None:
        return None
    return Sliders(target, tuple(Choice(CONTROLLERS[name]) for name in _HANDMADE))


def _plant(drawn: OpenLoop, result: Result, sliders: Sliders) -> NDArray[np.complex128]:
    """The plant's own response (F,): the loop's without controller and computation delay."""
    of: Any = sliders.choices[0].controller  # it sees the output
    target, omega = sliders.target, 2 * np.pi * drawn.frequency
    made = of.parallel(np.array([list(result.gains.values())]), target.Ts).compensator(target.Ts)
    controller = TransferFunction(made.output, made.denominator, target.Ts)(omega)[0]
    lag = omega * target.delay_samples * target.Ts
    return np.asarray(drawn.response / controller * np.exp(1j * lag))
