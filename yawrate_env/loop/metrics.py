"""Metrics of a batch of linear loops, by name.

====================  ==========================================================================
name                  meaning
====================  ==========================================================================
phase_margin [deg]    at the crossover
crossover [Hz]        where the loop's magnitude falls through 1 for good
gain_margin [dB]      at the phase crossover
delay_margin [s]      delay that takes up the phase margin
modulus_margin        least distance of the loop from -1
Ms                    largest sensitivity, one over that
overshoot [%]         of a step of the reference
settling_time [s]     until the output stays within 2 % of a step of the reference
IAE                   integral of the absolute output after a unit step at the plant's input
IE                    integral of the output after it; 1/Ki of a controller that integrates
====================  ==========================================================================

Responses in time are followed until the slowest pole has died away to 1e-4, for at most
`LONGEST` samples, and read at the controller's samples.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import kernel, over_blocks
from yawrate_env.loop.feedback import Feedback
from yawrate_env.loop.margins import Margins

Array = NDArray[np.float64]

LONGEST = 20_000

_BLOCK = 16
_GONE = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Closed:
    """B loops: their margins, and the loops in state space.

    Attributes
    ----------
    margins : Margins
    feedback : Feedback
    Ts : float
        Sampling time [s].
    """

    margins: Margins
    feedback: Feedback
    Ts: float
    _steps: list[Array] = field(default_factory=list, repr=False)

    @property
    def steps(self) -> Array:
        """Overshoot [1], settling time [s] and integrated absolute error (B, 3)."""
        if not self._steps:
            self._steps.append(_followed(self.feedback, self.Ts))
        return self._steps[0]

    @property
    def integrated_error(self) -> Array:
        """Integral of the output after a unit step at the plant's input, (B,)."""
        of = self.feedback
        inverse = np.linalg.pinv(np.eye(of.A.shape[1]) - of.A)
        steady = np.einsum("bij,bj->bi", inverse, of.disturbance)
        left = np.einsum("bi,bi->b", of.output, steady)
        total = -self.Ts * np.einsum("bi,bij,bj->b", of.output, inverse, steady)
        return np.where(np.abs(left) > 1e-9 * np.abs(steady).max(axis=1), np.inf, total)


Metric = Callable[[Closed], Array]

METRICS: dict[str, Metric] = {
    "phase_margin [deg]": lambda of: of.margins.phase_margin,
    "crossover [Hz]": lambda of: of.margins.crossover,
    "gain_margin [dB]": lambda of: of.margins.gain_margin,
    "delay_margin [s]": lambda of: of.margins.delay_margin,
    "modulus_margin": lambda of: of.margins.modulus_margin,
    "Ms": lambda of: 1 / of.margins.modulus_margin,
    "overshoot [%]": lambda of: 100 * of.steps[:, 0],
    "settling_time [s]": lambda of: of.steps[:, 1],
    "IAE": lambda of: of.steps[:, 2],
    "IE": lambda of: of.integrated_error,
}


def _followed(of: Feedback, Ts: float) -> Array:
    """Steps of B loops, each as long as it takes; ``nan`` of unstable loops."""
    slowest = np.abs(of.poles).max(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.ceil(np.log(_GONE) / np.log(slowest)) + of.A.shape[1]
    stable = slowest < 1
    samples = np.where(stable, np.clip(np.where(stable, needed, 1.0), 16, LONGEST), 0)
    found = np.full((len(of), 3), np.nan)
    lengths = samples.astype(np.int64)

    def some(i: int, j: int) -> None:
        _steps(of.A[i:j], of.reference[i:j], of.disturbance[i:j], of.output[i:j], lengths[i:j],
               Ts, found[i:j])  # fmt: skip

    over_blocks(some, len(of), _BLOCK)
    return found


@kernel
def _respond(A: Array, column: Array, row: Array, y: Array) -> None:
    """Response (N,) to a unit step from rest."""
    m = len(row)
    x, moved = np.zeros(m), np.zeros(m)
    for k in range(len(y)):
        y[k] = 0.0
        for i in range(m):
            y[k] += row[i] * x[i]
        for i in range(m):
            moved[i] = column[i]
            for j in range(m):
                moved[i] += A[i, j] * x[j]
        x, moved = moved, x


@kernel
def _steps(
    A: Array, reference: Array, disturbance: Array, output: Array, samples: NDArray[np.int64],
    Ts: float, found: Array,
) -> None:  # fmt: skip
    for b in range(len(A)):
        if samples[b] == 0:
            continue
        y = np.empty(samples[b])
        _respond(A[b], reference[b], output[b], y)
        peak, last = 0.0, -1
        for k in range(len(y)):
            peak = max(peak, y[k] - 1.0)
            if abs(y[k] - 1.0) > 0.02:
                last = k
        settled = np.inf
        if last < len(y) - 1:  # between the samples, so that it moves smoothly with the gains
            settled = 0.0
            if last >= 0:
                out, inside = abs(y[last] - 1.0), abs(y[last + 1] - 1.0)
                settled = (last + (out - 0.02) / (out - inside)) * Ts
        _respond(A[b], disturbance[b], output[b], y)
        total = 0.0
        for k in range(len(y)):
            total += abs(y[k]) * Ts
        found[b, 0], found[b, 1], found[b, 2] = peak, settled, total
