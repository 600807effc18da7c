"""Simulator, design rule and metrics of linear plants in a PI loop.

The project's own: exact zero-order hold, the loop-shaping rule of `yawrate_env.loop.design`,
margins of the sampled loop.  The plants are python-control models, one for each row of
parameters, or batches of matrices.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop import closed_loop, dead_time
from yawrate_env.loop.design import Status
from yawrate_env.loop.discretisation import DiscretePlant, zoh
from yawrate_env.loop.loops import Loops
from yawrate_env.loop.margins import open_loop
from yawrate_env.loop.target import Target
from yawrate_env.plant.names import split, word
from yawrate_env.plant.responses import ClosedLoop, OpenLoop, Response

Array = NDArray[np.float64]

PHASE_SCALE, CROSSOVER_SCALE = 10.0, 0.25
GAINS = ("kp", "Ti")
PULSE = 10.0
"""Length of a plant's pulse response, in periods of the crossover."""

METRICS = {"phase_margin [deg]": PHASE_SCALE, "crossover [Hz]": CROSSOVER_SCALE}
"""With the errors that count as one in the yaw-rate environment."""


@dataclass(frozen=True, slots=True)
class PILoop:
    """Simulator, design rule and evaluation for a `Plant`.

    Attributes
    ----------
    discrete : callable
        ``discrete(theta, Ts)``: parameters (B, p) to B plants at a sampling time [s].
    Ts : float
        Sampling time of the experiment [s].
    target : Target
        Design target, and the controller's sampling time.
    signals : tuple of str
        Names of input and output in pictures, with their units.
    """

    discrete: Callable[[Array, float], DiscretePlant]
    Ts: float
    target: Target
    signals: tuple[str, str] = ("", "")

    @classmethod
    def of(
        cls,
        model: Callable[[Array], Any],
        Ts: float,
        target: Target,
        signals: tuple[str, str] = ("", ""),
    ) -> Self:
        """Loop of a continuous python-control model.

        Parameters
        ----------
        model : callable
            ``model(theta)``: parameters (p,) of one plant to a transfer function or state space
            with one input, one output and no feedthrough.
        Ts, target, signals
            As of the loop.
        """
        return cls(_Modelled(model), Ts, target, signals)

    def simulate(self, theta: Array, u: Array, rng: Any) -> Array:
        """Noise-free outputs (B, N) from rest."""
        return dead_time.respond(self.discrete(theta, self.Ts), u)

    def design(self, theta: Array) -> tuple[Array, NDArray[np.bool_]]:
        """(kp, Ti) (B, 2), and whether they reach the target; ``nan`` where no PI comes near it."""
        found = self.loops(theta).design()
        return np.stack([found.kp, found.Ti], axis=1), found.status == Status.OK

    def evaluate(self, theta: Array, gains: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Phase margin [deg] and crossover [Hz], (B, 2), and whether loops are stable (B,)."""
        found = self.loops(theta).evaluate(*gains.T)
        margins = found.margins.phase_margin, found.margins.crossover
        return np.stack(margins, axis=1), found.stable

    def around(self, theta: Array, gains: Array) -> ClosedLoop:
        """The loop of gains (2,) around one plant (p,), for reports to draw."""
        target, loops = self.target, self.loops(theta[None])
        kp, Ti = gains[:, None]
        found = loops.evaluate(kp, Ti)
        frequency = np.geomspace(target.crossover / 30, 0.4999 / target.Ts, 400)
        L = open_loop(loops.transfer_function, kp, Ti, target)(2 * np.pi * frequency)[0]
        return ClosedLoop(
            self._responses(loops.plant, kp, Ti),
            OpenLoop(frequency, L, found.margins, self._pulse(loops.plant)),
            bool(found.stable[0]),
        )

    def loops(self, theta: Array) -> Loops:
        """PI loops around plants (B, p), at the controller's sampling time."""
        return Loops.of(self.discrete(theta, self.target.Ts), self.target)

    def _pulse(self, plant: DiscretePlant) -> Array | None:
        """Output (K,) for an input of one for one sample; None where it runs away."""
        samples = pulse_samples(self.target)
        none, one, at_rest = np.zeros(1), np.ones(1), np.zeros(samples)
        with np.errstate(over="ignore", invalid="ignore"):
            found, _ = closed_loop.time_response(
                plant, none, one, self.target, at_rest, np.eye(1, samples)[0]
            )
        return found[0] if np.isfinite(found).all() else None

    def _responses(self, plant: DiscretePlant, kp: Array, Ti: Array) -> tuple[Response, Response]:
        """Responses of the output to a step of the reference, and to one of the input."""
        target, (input, output) = self.target, self.signals
        time = target.Ts * np.arange(round(4 / target.crossover / target.Ts) + 1, dtype=np.float64)
        one, zero = np.ones(len(time)), np.zeros(len(time))
        with np.errstate(over="ignore", invalid="ignore"):
            step, _ = closed_loop.time_response(plant, kp, Ti, target, one)
            after, _ = closed_loop.time_response(plant, kp, Ti, target, zero, one)
        of_input, at_once = word(input, "input"), abs(float(plant.B[0] @ plant.C))
        stepped, disturbed = (f"by 1 {split(signal)[1]}".rstrip() for signal in (output, input))
        titles = f"Step of the reference {stepped}", f"Disturbance of the {of_input} {disturbed}"
        return (
            Response(titles[0], time, _bounded(step[0]), 1.0, output),
            Response(titles[1], time, _bounded(after[0], at_once), 0.0, output),
        )


def pulse_samples(target: Target) -> int:
    """Samples of a plant's pulse response at the controller's rate."""
    return round(PULSE / target.crossover / target.Ts) + 1


@dataclass(frozen=True, slots=True)
class _Modelled:
    """Models of one plant at a time, discretised."""

    model: Callable[[Array], Any]

    def __call__(self, theta: Array, Ts: float) -> DiscretePlant:
        return zoh(*_state_space([self.model(row) for row in theta]), Ts)


def _bounded(values: Array, least: float = 1.0) -> Array:
    """Without what follows once a loop has run away, a thousand times this or 1."""
    lost = np.maximum.accumulate(~(np.abs(values) < 1e3 * max(least, 1.0)))
    return np.where(lost, np.nan, values)


def _state_space(models: list[Any]) -> tuple[Array, Array, Array]:
    """Matrices (B, n, n), (B, n), (n,) of python-control models, in states that share C."""
    import control

    systems = [model if hasattr(model, "A") else control.ss(model) for model in models]
    first = systems[0]
    if (first.ninputs, first.noutputs) != (1, 1) or not first.isctime() or np.any(first.D):
        raise ValueError(
            f"the model has {first.ninputs} inputs, {first.noutputs} outputs, D = {first.D}, "
            f"dt = {first.dt}. Give a continuous one with one of each and D = 0."
        )
    A, B, C = (np.stack([getattr(system, name) for system in systems]) for name in "ABC")
    # A reflection takes every output row to a multiple of the first unit vector.
    size = np.linalg.norm(C, axis=2, keepdims=True)
    unit = np.eye(A.shape[1])[0]
    v = C / size + np.where(C[..., :1] < 0, -1.0, 1.0) * unit
    Q = np.eye(A.shape[1]) - 2 * v.swapaxes(1, 2) @ v / (v @ v.swapaxes(1, 2))
    sign = np.where(C[:, :, :1] < 0, 1.0, -1.0)
    return Q @ A @ Q, (Q @ B * size * sign)[:, :, 0], unit
