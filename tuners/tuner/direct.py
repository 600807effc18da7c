"""Direct methods: the gains of a PI from the recording alone, without a model of the plant.

Both want the loop of `reference_loop`, with closed loop M, and weigh all signals by W.

`VirtualReference` (Campi, Lecchini and Savaresi, Automatica 38, 2002) asks which controller
turns the error that the recorded output implies in the reference loop into the recorded input:

    minimise  || W M (1 - M) u - C W (1 - M)^2 y ||,

the paper's criterion with its filter ``M (1 - M)``; the input's spectrum, nearly flat where M
passes, is left out.  It is linear in the gains, but y is a regressor, whose noise would bias
them.  The instruments are the same regressors of the noise-free part of y: its projection on
Laguerre functions of the input.

`FictitiousReference` (Soma, Kaneko and Fujii, IFAC ALCOSP, 2004) asks for the controller with which
the recorded output is the reference model's answer to ``C^-1 u + y``, the reference it implies:

    minimise  || W (1 - M) y - W M C^-1 u ||,

nonlinear least squares (`inverse_pi`).  In an open-loop recording u has no noise, and nothing is
biased.

**Weight.**  With two gains a PI gives few plants the reference loop at all frequencies, and the
best compromise may miss the margins by far: the loops of the paper's vehicles have half the
reference loop's gain at low frequencies and more lag above the crossover.  Margins are decided at
the crossover, so W is a band-pass there, two resonators in series; docs/direct.md says how it
was chosen, and what both methods give with W = 1.

**Sampling.**  The controller has a sampling time of its own, n samples of the recording.  Behind
its hold the plant answers as it does at the recording's rate to the mean of n samples, but for
aliases far above the crossover.  So y is averaged over n samples, and the recording is used as n
interleaved ones at the controller's rate.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre import Laguerre
from tuners.tuner import inverse_pi
from tuners.tuner.method import Gains
from tuners.tuner.recording import Recording
from tuners.tuner.reference_loop import ReferenceLoop, filtered
from tuners.tuner.rivals import Untrained
from yawrate_env import validation
from yawrate_env.compiled import LANES, over_blocks
from yawrate_env.loop.controller import warped
from yawrate_env.loop.design import Status, design_from_response
from yawrate_env.loop.target import Target
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

QUALITY = 8.0
"""Crossover over the bandwidth of each of W's resonators."""

_FUNCTIONS = 12  # Laguerre functions of the input, with their pole at the crossover
_SINGULAR = 1e-12  # of the product of a matrix' diagonal: no determinant


@dataclass(frozen=True)
class _Direct(Untrained, ABC):
    """A direct method.

    Attributes
    ----------
    quality : float or None
        Of the weight's resonators; None weighs all frequencies alike.
    """

    quality: float | None = QUALITY

    needs_excitation: ClassVar[bool] = True
    any_measured: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.quality is not None:
            validation.number("quality", self.quality, above=0.0, remedy="Give a number or None.")

    def gains(self, plant: Plant, recording: Recording) -> Gains:
        """PI gains (kp, Ti) for every recording."""
        loop = ReferenceLoop.of(target_of(plant))
        step = max(round(loop.target.Ts / recording.Ts), 1)
        used = recording.resampled(loop.target.Ts / step)
        if used.y.shape[1] < 10 * _FUNCTIONS * step:
            raise ValueError(
                f"{recording.y.shape[1]} samples are too few for {10 * _FUNCTIONS} samples of the "
                "controller. Record for longer."
            )
        responses = np.empty(len(used), dtype=np.complex128)

        def some(i: int, j: int) -> None:
            part = used.part(slice(i, j))
            with np.errstate(all="ignore"):  # not a number: no gains
                responses[i:j] = self.controller(loop, part.u, part.y, step)

        over_blocks(some, len(used), LANES)
        return _gains(responses, loop.target)

    @abstractmethod
    def controller(self, loop: ReferenceLoop, u: Array, y: Array, step: int) -> Complex:
        """Response (B,) at the crossover of the controllers found; ``nan`` where none is.

        Parameters
        ----------
        u, y : (1 or B, N) and (B, N)
            From rest, sampled `step` times in a sample of the controller.
        """

    def settings(self) -> dict[str, Any]:
        """The weight."""
        return {"quality": self.quality}

    @classmethod
    def from_file(cls, settings: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> Self:
        """With the weight that was saved."""
        return cls(settings.get("quality", QUALITY))

    def weighed(self, loop: ReferenceLoop, u: Array, y: Array, step: int) -> tuple[Array, Array]:
        """``W M u`` and ``W (1 - M) y``, y behind the controller's hold and delay."""
        delay = np.zeros(loop.target.delay_samples)
        held = filtered(np.full(step, 1 / step), np.ones(1), y, 1)
        signals = [
            filtered(loop.gain, loop.closed, u, step),
            filtered(np.concatenate([delay, loop.sensitivity]), loop.closed, held, step),
        ]
        if self.quality is not None:
            for _ in range(2):
                signals = [filtered(*loop.resonator(self.quality), s, step) for s in signals]
        return signals[0], signals[1]


class VirtualReference(_Direct):
    """Virtual reference feedback tuning, with instruments."""

    kind: ClassVar[str] = "vrft"

    def controller(self, loop: ReferenceLoop, u: Array, y: Array, step: int) -> Complex:
        """Instrumental variables: one linear equation for each gain."""
        return self.solved(loop, u, y, _explained(loop.target, u, y, step), step)

    def solved(
        self, loop: ReferenceLoop, u: Array, y: Array, instruments: Array, step: int
    ) -> Complex:
        """The same with other outputs (B, N) as instruments; y itself gives least squares."""
        input, output = self.weighed(loop, u, y, step)
        _, instrument = self.weighed(loop, u, instruments, step)
        Ts, S, mean = loop.target.Ts, loop.sensitivity, np.array([0.5, 0.5])
        if loop.target.controller == "pi":  # u = (kp + kp/Ti Ts/2 (1 + q)/(1 - q)) e
            wanted = filtered(S, loop.closed, input, step)
            of_error, of_input = [S, Ts * np.convolve(mean, loop.lag)], []
        else:  # (1 + q)/2 u = kp (1 + q)/2 e - Ti (1 - q)/Ts u
            of_error = [np.convolve(mean, S)]
            wanted = filtered(of_error[0], loop.closed, input, step)
            of_input = [filtered(np.convolve([-1 / Ts, 1 / Ts], S), loop.closed, input, step)]

        def regressors(signal: Array) -> Array:
            errors = (filtered(b, loop.closed, signal, step) for b in of_error)
            return np.stack([np.broadcast_to(x, y.shape) for x in (*errors, *of_input)], axis=1)

        x = _solve(regressors(instrument), regressors(output), wanted)
        return _response(x[0], x[1], loop.target)


class FictitiousReference(_Direct):
    """Fictitious reference iterative tuning, by nonlinear least squares."""

    kind: ClassVar[str] = "frit"

    def controller(self, loop: ReferenceLoop, u: Array, y: Array, step: int) -> Complex:
        """The best inverse controller."""
        input, output = self.weighed(loop, u, y, step)
        if loop.target.controller == "pi":
            return inverse_pi.controller(loop.target, input, output, step)
        # (1 + q)/2 of all: 1/kp (1 + Ti s) is linear in its coefficients
        one, of_input = np.ones(1), (np.array([0.5, 0.5]), np.array([1.0, -1.0]) / loop.target.Ts)
        inputs = [filtered(b, one, input, step) for b in of_input]
        regressors = np.stack([np.broadcast_to(x, y.shape) for x in inputs], axis=1)
        x = _solve(regressors, regressors, filtered(of_input[0], one, output, step))
        return _response(1 / x[0], x[1] / x[0], loop.target)


def target_of(plant: Plant) -> Target:
    """What a plant's PI must reach; ``ValueError`` where it has no such target."""
    target = plant.parametrisation.target
    if target is None or len(plant.gains) != 2:
        raise ValueError(
            "vrft and frit need a plant with a PI at a loop target: describe it with "
            "parametrisation=loop(Target(...)) and its two gains kp and Ti."
        )
    return target


def _response(kp: Array, second: Array, target: Target) -> Complex:
    """Response (B,) at the crossover of ``kp + kp/Ti 1/s``, or of ``kp / (1 + Ti s)``.

    The second coefficient is the integral's ``kp/Ti``, or the printed form's Ti.
    """
    if target.controller == "pi":
        return np.asarray(kp - 1j * second / warped(target))
    return np.asarray(kp / (1 + 1j * second * warped(target)))


def _explained(target: Target, u: Array, y: Array, step: int) -> Array:
    """Projection of outputs (B, N) on Laguerre functions of the input."""
    functions, Ts = Laguerre(_FUNCTIONS, target.omega_c), target.Ts / step
    coefficients = functions.coefficients(u, y, Ts, np.empty((0, y.shape[1])))
    return np.asarray((coefficients[:, None] @ functions.regressors(u, Ts))[:, 0])


def _solve(instruments: Array, regressors: Array, wanted: Array) -> Array:
    """Two coefficients (2, B) of regressors (B, 2, N); ``nan`` where they are not determined."""
    (a, b), (c, d) = np.einsum("bin,bjn->ijb", instruments, regressors)
    first, second = np.einsum("bin,bn->ib", instruments, wanted)
    determinant = a * d - b * c
    determinant = np.where(np.abs(determinant) > _SINGULAR * np.abs(a * d), determinant, np.nan)
    return np.stack([d * first - b * second, a * second - c * first]) / determinant


def _gains(responses: Complex, target: Target) -> Gains:
    """Gains of controllers with these responses (B,) at the crossover.

    An integral part of the wrong sign is a phase that no PI supplies, treated as the design rule
    treats it.
    """
    phase = np.angle(responses)
    phase = np.where(phase > np.pi / 2, phase - 2 * np.pi, phase)  # kp < 0: out of reach
    with np.errstate(divide="ignore", over="ignore"):  # a gain of zero: no gains
        found = design_from_response(np.log(np.abs(responses)), phase, target)
    values = np.stack([found.kp, found.Ti], axis=1)
    return Gains.of(values, found.status == Status.OK, np.isfinite(responses))
