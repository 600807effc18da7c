"""What a reader of a report may move of a loop, and the gains that its design rule then gives.

Rule R has its gains in closed form, which the page computes from the plant's response.  Of other
rules the gains are computed here, for each of some values of what the rule is asked for:

=================  ==========================  ==============================
rule               asked for                   value, loop s times as fast
=================  ==========================  ==============================
simc, lambda, imc  time constant of the loop   tau_c/s
ms                 largest sensitivity         1 + (Ms - 1) s
lqr                weight of the input         weight/s^2
amigo, a function  nothing
=================  ==========================  ==============================
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop.controllers import CONTROLLERS, Controller
from yawrate_env.loop.state_feedback import STATE_FEEDBACK
from yawrate_env.loop.target import Target
from yawrate_env.plant.rules import LOOP_SHAPING, RULES, Pace, seen

Array = NDArray[np.float64]

MOST_DELAY = 10
"""Samples of computation delay beyond the target's."""

A_HALF_FASTER = 8
"""Values from one loop to another that is 1.5 times as fast."""

_STEP = 1.5 ** (1 / A_HALF_FASTER)
_STEPS, _MANY = 18, 45  # to either side; of a weight, which goes with the square
_OFFERED = "P", "PI", "PD", "PID", "PIDF", "PI-D", "2DOF", "lead-lag"
_ONE = 1e-5  # how far from 1 rounding may take the poles of two or three integrators


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    """What a rule is asked for.

    Attributes
    ----------
    label : str
        Its name, with the unit in brackets.
    values : NDArray
        (M,) rising.
    start : int
        Index of the loop's own.
    faster : int
        1 where greater values give faster loops, else -1.
    """

    label: str
    values: Array
    start: int
    faster: int


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """A controller.

    Attributes
    ----------
    controller : Controller
    gains : NDArray, optional
        (D, M, k) by computation delay, from none on, and what is asked for; None for rule R.
    """

    controller: Controller
    gains: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Sliders:
    """What may be moved of one loop.

    Attributes
    ----------
    target : Target
        Sampling time and computation delay; and what rule R aims at.
    choices : tuple of Choice
        The loop's own controller first.
    asked : Request, optional
        What the rule is asked for; None for rule R, and for rules of one speed.
    unstable, integrators : int, optional
        Poles of the plant outside the unit circle, and at 1, where they are known.
    states : callable, optional
        Of a state feedback: ``states(omega, K)`` gives responses (n, F) complex128 and pulse
        responses (n, K) of the states.
    """

    target: Target
    choices: tuple[Choice, ...]
    asked: Request | None = None
    unstable: int | None = None
    integrators: int | None = None
    states: Callable[[Array, int], tuple[NDArray[np.complex128], Array]] | None = None

    @property
    def shaped(self) -> bool:
        """Whether rule R gives the gains."""
        return self.choices[0].gains is None


def of_loop(loop: Any, theta: Array) -> Sliders:
    """What may be moved of a `ControlLoop` around one plant (p,)."""
    plant = loop.sampled(theta[None])
    size = np.abs(poles := np.linalg.eigvals(plant.A[0]))
    unstable, at_one = int((size > 1 + _ONE).sum()), int((np.abs(poles - 1) <= _ONE).sum())
    own = loop.controller
    known = [own] if callable(loop.rule) else [own, *_others(own, loop.rule)]
    if loop.rule == LOOP_SHAPING:
        return Sliders(loop.target, tuple(map(Choice, known)), None, unstable, at_one)
    loop = replace(loop, tau_c=_tau_c(loop, theta))
    asked, speeds = _asked(loop)
    shared = {one: one if callable(loop.rule) else _widest(one) for one in known}
    found = {one: _gains(replace(loop, controller=one), theta, speeds)
             for one in dict.fromkeys(shared.values())}  # fmt: skip
    choices = tuple(Choice(one, _columns(one, wide, found[wide])) for one, wide in shared.items())
    states = _states(plant) if own.name == STATE_FEEDBACK else None
    return Sliders(loop.target, choices, asked, unstable, at_one, states)


def _others(own: Controller, rule: str) -> list[Controller]:
    """Controllers that the rule knows, too."""
    if own.name not in CONTROLLERS:
        return []
    return [CONTROLLERS[name] for name in _OFFERED
            if name != own.name and rule in CONTROLLERS[name].rules]  # fmt: skip


def _widest(of: Controller) -> Controller:
    """The controller with the same gains and more, which rules for processes find alike."""
    return CONTROLLERS["2DOF"] if {"Ti", "Tf"} <= set(of.gains) else of


def _columns(of: Controller, widest: Controller, gains: Array) -> Array:
    """The controller's own gains among those (D, M, k) of one with more."""
    return gains[..., [widest.gains.index(name) for name in of.gains]]


def _tau_c(loop: Any, theta: Array) -> float | None:
    """The time constant that is asked for; the dead time where none is given."""
    if loop.tau_c or loop.process is None:
        return None if loop.tau_c is None else float(loop.tau_c)
    return float(seen(loop, theta[None], loop.target.delay_samples).dead_time[0])


def _asked(loop: Any) -> tuple[Request | None, Array]:
    """What the rule is asked for, and the speeds (M,) of its values."""
    rule = "" if callable(loop.rule) else loop.rule
    steps = _MANY if rule == "lqr" else _STEPS
    speeds = loop.speed * _STEP ** np.arange(-steps, steps + 1.0)
    slower = speeds[::-1]
    if rule in ("simc", "lambda", "imc"):
        label, values = "time constant of the loop [s]", loop.tau_c / slower
        return Request(label, values, steps, -1), slower
    if rule == "ms":
        return Request("largest sensitivity", 1 + (loop.Ms - 1) * speeds, steps, 1), speeds
    if rule == "lqr":
        return Request("weight of the input", loop.weight / slower**2, steps, -1), slower
    return None, np.array([loop.speed])


def _gains(loop: Any, theta: Array, speeds: Array) -> Array:
    """Gains (D, M, k) of a loop's rule."""
    delays = np.arange(loop.target.delay_samples + MOST_DELAY + 1)
    shape = len(delays), len(speeds), len(loop.controller.gains)
    if callable(loop.rule):
        loops = (replace(loop, target=replace(loop.target, delay_samples=int(d))) for d in delays)
        return np.stack([one.design(theta[None])[0] for one in loops])
    pace = Pace(np.tile(speeds, len(delays)), delays.repeat(len(speeds)))
    rows = np.broadcast_to(theta, (len(delays) * len(speeds), len(theta)))
    return np.asarray(RULES[loop.rule](loop, rows, pace)[0].reshape(shape))


def _states(plant: Any) -> Callable[[Array, int], tuple[NDArray[np.complex128], Array]]:
    """Responses and pulse responses of one plant's states."""
    A, B, Ts = plant.A[0], plant.B[0], plant.Ts

    def of(omega: Array, samples: int) -> tuple[NDArray[np.complex128], Array]:
        z = np.exp(1j * omega * Ts)
        found = np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, B[:, None])
        pulse, x = np.zeros((samples, len(A))), B
        for k in range(1, samples):
            pulse[k], x = x, A @ x
        return found[:, :, 0].T, pulse.T.copy()

    return of
