"""Simulator, design rule and metrics of linear plants in the loop of any controller.

The project's own: exact zero-order hold, rules by name (`yawrate_env.plant.rules`), margins and
steps of the sampled loop (`yawrate_env.loop.metrics`).  The plants are python-control models, one
for each row of parameters, or batches of matrices.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.loop import dead_time
from yawrate_env.loop.controllers import CONTROLLERS, Controller, of_target
from yawrate_env.loop.discretisation import DiscretePlant, zoh
from yawrate_env.loop.margins import margins
from yawrate_env.loop.metrics import METRICS, Closed
from yawrate_env.loop.process_rules import PROCESS_RULES, Process
from yawrate_env.loop.state_feedback import STATE_FEEDBACK
from yawrate_env.loop.target import Target
from yawrate_env.plant.metric import Metric
from yawrate_env.plant.names import split, word
from yawrate_env.plant.parametrisation import Parametrisation, loop, of_gains
from yawrate_env.plant.plant import Plant
from yawrate_env.plant.responses import ClosedLoop, OpenLoop, Response
from yawrate_env.plant.rules import LOOP_SHAPING, RULES, Pace
from yawrate_env.plant.sliders import Sliders, of_loop

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Rule = Callable[["ControlLoop", Array], tuple[Array, Flags]]

PHASE_SCALE, CROSSOVER_SCALE = 10.0, 0.25
PULSE = 10.0
"""Length of a plant's pulse response, in periods of the crossover."""

MARGINS = ("phase_margin [deg]", "crossover [Hz]")
"""What rule R aims at."""

SCALES = {
    "phase_margin [deg]": PHASE_SCALE,
    "gain_margin [dB]": 4.0,  # 10 % of the gain needs no care, 20 % is no miss
    "modulus_margin": 0.2,
    "Ms": 0.5,
    "overshoot [%]": 20.0,
}
"""Errors that count as one, of metrics whose size does not depend on the plant's; those of the
yaw-rate environment where it has them.  An error of a sixth of the wanted crossover counts as one,
as there."""

SPEEDS = {"slow": 2 / 3, "medium": 1.0, "fast": 1.5}
"""Loops that are offered beside each other, as fast as the rule's by these factors."""


@dataclass(frozen=True, slots=True)
class ControlLoop:
    """Simulator, design rule and evaluation for a `Plant`.

    Attributes
    ----------
    discrete : callable
        ``discrete(theta, Ts)``: parameters (B, p) to B plants at a sampling time [s].
    Ts : float
        Sampling time of the experiment [s].
    target : Target
        The controller's sampling time and computation delay, and what rule R aims at; without
        rule R the crossover is only a guess.
    signals : tuple of str
        Names of input and output in pictures, with their units.
    controller : Controller or str
        In the loop; by its name in `yawrate_env.loop.controllers`.  By default the target's PI.
    rule : str or callable
        Name of a design rule, or ``rule(loop, theta)``: this loop and parameters (B, p) to gains
        (B, k), and whether they are as asked (B,).
    metrics : tuple of str
        Names of what `evaluate` gives, of `yawrate_env.loop.metrics`.
    process : callable, optional
        ``process(theta)``: parameters (B, p) as a `Process`, for rules that are for these.
    tau_c : float, optional
        Wanted time constant of the closed loop, for SIMC and lambda [s]; the dead time if omitted.
    Ms : float
        Largest sensitivity, for the rule of that name.
    N : float
        Derivative time over filter time.
    weight : float
        Of the squared input against the squared output, for LQR.
    speed : float
        How many times as fast as asked a loop is to be.
    """

    discrete: Callable[[Array, float], DiscretePlant]
    Ts: float
    target: Target
    signals: tuple[str, str] = ("", "")
    controller: Any = None
    rule: str | Rule = LOOP_SHAPING
    metrics: tuple[str, ...] = MARGINS
    process: Callable[[Array], Process] | None = None
    tau_c: float | None = None
    Ms: float = 1.4
    N: float = 10.0
    weight: float = 1.0
    speed: float = 1.0

    def __post_init__(self) -> None:
        chosen = of_target(self.target) if self.controller is None else self.controller
        if isinstance(chosen, str):
            chosen = CONTROLLERS[validation.one_of("controller", chosen, tuple(CONTROLLERS))]
        object.__setattr__(self, "controller", chosen)
        object.__setattr__(self, "metrics", tuple(self.metrics))
        if not callable(self.rule):
            validation.one_of("rule", self.rule, tuple(RULES))
            _check_suits(self.rule, chosen, self.process is not None)
        for name in self.metrics:
            validation.one_of("metric", name, tuple(METRICS))
        if self.tau_c is not None:
            validation.number("tau_c", self.tau_c, above=0.0, remedy="Give it in seconds.")
        validation.number("Ms", self.Ms, above=1.0, at_most=10.0, remedy="1.2 to 2 are usual.")
        for name in ("N", "weight", "speed"):
            validation.number(name, getattr(self, name), above=0.0, remedy="Give a positive one.")

    @classmethod
    def of(
        cls,
        model: Callable[[Array], Any],
        Ts: float,
        target: Target,
        signals: tuple[str, str] = ("", ""),
        **settings: Any,
    ) -> Self:
        """Loop of a continuous python-control model.

        Parameters
        ----------
        model : callable
            ``model(theta)``: parameters (p,) of one plant to a transfer function or state space
            with one input, one output and no feedthrough.
        Ts, target, signals, settings
            As of the loop.
        """
        chosen = settings.get("controller")
        own = getattr(chosen, "name", chosen) == STATE_FEEDBACK
        return cls(_Modelled(model, own), Ts, target, signals, **settings)

    def plant(self, **settings: Any) -> Plant:
        """The plant of this loop; `settings` are further ones of `Plant`, or others than these."""
        given = {
            "simulate": self.simulate,
            "design": self.design,
            "evaluate": self.evaluate,
            "loop": self.around,
            "controller": self.controller.name,
            "gains": self.controller.gains,
            "metrics": self.settings,
            "parametrisation": self.parametrisation,
            "speeds": self.speeds if self.has_speeds else None,
            "sliders": None if {"design", "gains"} & set(settings) else self.sliders,
            "Ts": self.Ts,
            "linear": True,
            "signals": self.signals,
        }
        return Plant(**{**given, **settings})

    @property
    def settings(self) -> dict[str, Metric]:
        """The metrics with their usual scales; those whose size is the plant's are reported."""
        scales = {**SCALES, "crossover [Hz]": self.target.crossover / 6}
        return {name: Metric(scales.get(name, np.inf)) for name in self.metrics}

    @property
    def parametrisation(self) -> Parametrisation:
        """Loop coordinates of a PI by rule R; logarithms, or signed gains, of others."""
        if self.rule == LOOP_SHAPING and self.controller == of_target(self.target):
            return loop(self.target)
        return of_gains(self.controller.coordinates)

    def simulate(self, theta: Array, u: Array, rng: Any) -> Array:
        """Noise-free outputs (B, N) from rest."""
        return dead_time.respond(self.discrete(theta, self.Ts), u)

    def design(self, theta: Array) -> tuple[Array, Flags]:
        """Gains (B, k) of the rule, and whether they are as asked; ``nan`` where there are none."""
        if callable(self.rule):
            return self.rule(self, theta)
        return RULES[self.rule](self, theta, Pace(self.speed, self.target.delay_samples))

    def evaluate(self, theta: Array, gains: Array) -> tuple[Array, Flags]:
        """Metrics (B, f), and whether loops are stable (B,)."""
        usable = self.controller.usable(gains)
        found = np.full((len(gains), len(self.metrics)), np.nan)
        stable = np.zeros(len(gains), dtype=np.bool_)
        if usable.any():
            closed = self.closed(theta[usable], gains[usable])
            found[usable] = np.stack([METRICS[name](closed) for name in self.metrics], axis=1)
            stable[usable] = closed.feedback.stable
        return found, stable

    def speeds(self, theta: Array) -> dict[str, Array]:
        """Gains (k,) of slower and faster loops around one plant (p,), by `SPEEDS`."""
        loops = {name: replace(self, speed=self.speed * factor) for name, factor in SPEEDS.items()}
        return {name: one.design(theta[None])[0][0] for name, one in loops.items()}

    def sliders(self, theta: Array) -> Sliders:
        """What a report lets its reader move of the loop around one plant (p,)."""
        return of_loop(self, theta)

    @property
    def has_speeds(self) -> bool:
        """Whether the rule knows faster and slower loops."""
        return not callable(self.rule) and self.rule != "amigo"

    def around(self, theta: Array, gains: Array) -> ClosedLoop:
        """The loop of gains (k,) around one plant (p,), for reports to draw."""
        closed, target = self.closed(theta[None], gains[None]), self.target
        crossover = target.crossover
        if self.rule != LOOP_SHAPING and np.isfinite(found := closed.margins.crossover[0]):
            crossover = float(np.clip(found, 1e-4 / target.Ts, 0.45 / target.Ts))
        frequency = np.geomspace(crossover / 30, 0.4999 / target.Ts, 400)
        plant = self.sampled(theta[None])
        made = self.controller.open_loop(plant, gains[None], target.delay_samples)
        seen = replace(target, crossover=crossover)
        return ClosedLoop(
            self._responses(closed, seen, abs(float(plant.B[0] @ plant.C))),
            OpenLoop(frequency, made(2 * np.pi * frequency)[0], closed.margins,
                     _pulse(plant, pulse_samples(seen))),
            bool(closed.feedback.stable[0]),
        )  # fmt: skip

    def closed(self, theta: Array, gains: Array) -> Closed:
        """Loops of usable gains (B, k) around plants (B, p)."""
        plant, of, delay = self.sampled(theta), self.controller, self.target.delay_samples
        feedback = of.close(plant, gains, delay)
        return Closed(margins(of.open_loop(plant, gains, delay)), feedback, self.target.Ts)

    def sampled(self, theta: Array) -> DiscretePlant:
        """Plants (B, p) at the controller's sampling time."""
        return self.discrete(theta, self.target.Ts)

    def _responses(
        self, closed: Closed, target: Target, at_once: float
    ) -> tuple[Response, Response]:
        """Responses of the output to a step of the reference, and to one of the input."""
        input, output = self.signals
        time = target.Ts * np.arange(round(4 / target.crossover / target.Ts) + 1, dtype=np.float64)
        one, zero = np.ones(len(time)), np.zeros(len(time))
        with np.errstate(over="ignore", invalid="ignore"):
            step, _ = closed.feedback.respond(one)
            after, _ = closed.feedback.respond(zero, one)
        stepped, disturbed = (f"by 1 {split(signal)[1]}".rstrip() for signal in (output, input))
        of_input = word(input, "input")
        titles = f"Step of the reference {stepped}", f"Disturbance of the {of_input} {disturbed}"
        return (
            Response(titles[0], time, _bounded(step[0]), 1.0, output),
            Response(titles[1], time, _bounded(after[0], at_once), 0.0, output),
        )


def _check_suits(rule: str, of: Controller, is_process: bool) -> None:
    """``ValueError`` where a rule is not for this controller."""
    if of.name not in (suited := of.rules) and rule not in suited:
        raise ValueError(
            f"rule = {rule!r} is not for controller {of.name!r}. Choose one of "
            f"{', '.join(suited)}, or give a function."
        )
    if rule in PROCESS_RULES and not is_process:
        raise ValueError(
            f"rule = {rule!r} is for processes: give process=, which makes gain, lags and dead "
            "time of parameters, or choose another rule."
        )


def _pulse(plant: DiscretePlant, samples: int) -> Array | None:
    """Output (K,) of one plant for an input of one for one sample; None where it runs away."""
    with np.errstate(over="ignore", invalid="ignore"):
        found = dead_time.respond(plant, np.eye(1, samples)[0])[0]
    return found if np.isfinite(found).all() else None


def pulse_samples(target: Target) -> int:
    """Samples of a plant's pulse response at the controller's rate."""
    return round(PULSE / target.crossover / target.Ts) + 1


@dataclass(frozen=True, slots=True)
class _Modelled:
    """Models of one plant at a time, discretised."""

    model: Callable[[Array], Any]
    own_states: bool = False

    def __call__(self, theta: Array, Ts: float) -> DiscretePlant:
        return zoh(*_state_space([self.model(row) for row in theta], self.own_states), Ts)


def _bounded(values: Array, least: float = 1.0) -> Array:
    """Without what follows once a loop has run away, a thousand times this or 1."""
    lost = np.maximum.accumulate(~(np.abs(values) < 1e3 * max(least, 1.0)))
    return np.where(lost, np.nan, values)


def _state_space(models: list[Any], own: bool) -> tuple[Array, Array, Array]:
    """Matrices (B, n, n), (B, n), (n,) of python-control models, in states that share C.

    These are the models' own where they share it, as they must where `own`.
    """
    import control

    systems = [model if hasattr(model, "A") else control.ss(model) for model in models]
    first = systems[0]
    if (first.ninputs, first.noutputs) != (1, 1) or not first.isctime() or np.any(first.D):
        raise ValueError(
            f"the model has {first.ninputs} inputs, {first.noutputs} outputs, D = {first.D}, "
            f"dt = {first.dt}. Give a continuous one with one of each and D = 0."
        )
    A, B, C = (np.stack([getattr(system, name) for system in systems]) for name in "ABC")
    if (C == C[0]).all():
        return A, B[:, :, 0], C[0, 0]
    if own:
        raise ValueError(
            "the model's output row differs from plant to plant, so that its states have no common "
            "meaning for a state feedback. Give control.ss models with the same C."
        )
    # A reflection takes every output row to a multiple of the first unit vector.
    size = np.linalg.norm(C, axis=2, keepdims=True)
    unit = np.eye(A.shape[1])[0]
    v = C / size + np.where(C[..., :1] < 0, -1.0, 1.0) * unit
    Q = np.eye(A.shape[1]) - 2 * v.swapaxes(1, 2) @ v / (v @ v.swapaxes(1, 2))
    sign = np.where(C[:, :, :1] < 0, 1.0, -1.0)
    return Q @ A @ Q, (Q @ B * size * sign)[:, :, 0], unit
