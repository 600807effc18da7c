"""Design rules by name, for the loop of a plant (`yawrate_env.plant.control_loop`).

=============  ====================================================  =========================
rule           gives                                                 for
=============  ====================================================  =========================
loop-shaping   phase margin and crossover of the target (rule R)     P to PIDF, PI-D, 2DOF and
                                                                     lead-lag, any plant
simc           a closed loop of time constant tau_c                  PI, PID, ..., of processes
lambda, imc    the same, with poles and zeros cancelled              PI, PID, ..., of processes
amigo          a largest sensitivity of about 1.4                    PI, PID, ..., of processes
ms             the largest kp/Ti with a largest sensitivity of Ms    PI, PID, ..., any plant that
                                                                     is stable alone
lqr            the least sum of y^2 + weight u^2                     state feedback, any plant
               without dead time
=============  ====================================================  =========================

A derivative's filter is ``Tf = Td/N``, and at least half a sampling time.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop import shaping
from yawrate_env.loop.design import Status, required_response
from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.parallel import Parallel
from yawrate_env.loop.process_rules import PROCESS_RULES, Process, Standard
from yawrate_env.loop.state_feedback import reference_gain
from yawrate_env.loop.target import Target
from yawrate_env.loop.transfer_function import TransferFunction

Array = NDArray[np.float64]
Designed = tuple[Array, NDArray[np.bool_]]


class DesignedLoop(Protocol):
    """What rules ask of a loop; `yawrate_env.plant.control_loop.ControlLoop` says what it is."""

    @property
    def target(self) -> Target:
        """Sampling time, delay, and what rule R aims at."""

    @property
    def controller(self) -> Any:
        """In the loop."""

    @property
    def rule(self) -> Any:
        """Its name, or a function."""

    @property
    def process(self) -> Callable[[Array], Process] | None:
        """From parameters to processes."""

    @property
    def tau_c(self) -> float | None:
        """Wanted time constant [s]."""

    @property
    def Ms(self) -> float:
        """Largest sensitivity."""

    @property
    def N(self) -> float:
        """Derivative time over filter time."""

    @property
    def weight(self) -> float:
        """Of the squared input."""

    @property
    def speed(self) -> float:
        """How many times as fast as asked."""

    def sampled(self, theta: Array) -> DiscretePlant:
        """Plants at the controller's sampling time."""


def shaped(loop: DesignedLoop, theta: Array) -> Designed:
    """Rule R at the target, whose crossover goes with the loop's speed."""
    target = replace(loop.target, crossover=loop.speed * loop.target.crossover)
    plant = TransferFunction.of(loop.sampled(theta), target.delay_samples)
    gains, status = loop.controller.shape(*required_response(plant, target), target)
    return gains, status == Status.OK


def of_process(loop: DesignedLoop, theta: Array) -> Designed:
    """A rule for processes."""
    assert loop.process is not None  # the loop has checked it
    process = loop.process(theta)
    tau_c = np.full(len(theta), loop.tau_c) if loop.tau_c else process.dead_time
    found = PROCESS_RULES[loop.rule](process, loop.controller.derives, tau_c / loop.speed)
    gains = loop.controller.pick(_named(loop, found))
    return gains, _found(gains)


def constrained(loop: DesignedLoop, theta: Array) -> Designed:
    """The largest kp/Ti with a largest sensitivity; a PID has ``Td = Ti/4``."""
    of, Ts, delay = loop.controller, loop.target.Ts, loop.target.delay_samples
    plant = TransferFunction.of(loop.sampled(theta), delay)

    def standard(kp: Array, Ti: Array) -> Array:
        one = np.ones_like(Ti)
        return np.asarray(of.pick(_named(loop, Standard(kp, Ti, Ti / 4, one))))

    def unit(Ti: Array) -> TransferFunction:
        made: Parallel = of.parallel(standard(np.ones_like(Ti), Ti), Ts)
        return made.compensator(Ts).around(plant)

    Ms = 1 + (loop.Ms - 1) * loop.speed
    gains = standard(*shaping.constrained(unit, len(theta), Ms, Ts).T)
    return gains, _found(gains)


def optimal(loop: DesignedLoop, theta: Array) -> Designed:
    """The linear-quadratic regulator."""
    plant = loop.sampled(theta)
    K = shaping.lqr(plant, loop.weight / loop.speed**2)
    found = _found(K)
    kr = reference_gain(plant, np.where(found[:, None], K, 0.0))
    gains = np.column_stack([K, np.where(found, kr, np.nan)])
    return gains, _found(gains)


def _found(gains: Array) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(gains).all(axis=1))


def _named(loop: DesignedLoop, found: Standard) -> dict[str, Array]:
    """A rule's gains by name, with the derivative's filter."""
    Tf = np.maximum(found.Td / loop.N, loop.target.Ts / 2)
    return {"kp": found.kp, "Ti": found.Ti, "Td": found.Td, "Tf": Tf, "b": found.b}


LOOP_SHAPING = "loop-shaping"
RULES: dict[str, Callable[[DesignedLoop, Array], Designed]] = {
    LOOP_SHAPING: shaped,
    **dict.fromkeys(PROCESS_RULES, of_process),
    "ms": constrained,
    "lqr": optimal,
}
"""By name; each gives gains (B, k), and whether they are as asked (B,)."""
