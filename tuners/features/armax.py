"""First stage: ARMAX(2, 2, 2, 1) by prediction-error minimisation, eq. (3).

    y[k] + a1 y[k-1] + a2 y[k-2] = b1 u[k-1] + b2 u[k-2] + e[k] + c1 e[k-1] + c2 e[k-2]

The sum of squared one-step prediction errors ``e = (A y - B u)/C``, from rest and over
all samples, is minimised by Levenberg and Marquardt's method (Ljung, *System
Identification*, 2nd ed., sections 10.2 and 10.3), ``LANES`` episodes side by side.  For a
fixed C the error is linear in A and B, which gives the start (`tuners.features.armax_passes`).

For a plant of higher order the cost of this second-order model has several minima.  Starting
from a fast C finds pysib's minimum on every episode tried; Steiglitz and McBride's
``C := A`` is rejected: it may end at a worse one, with a root of C at 1.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tuners.features.armax_passes import COST, PARAMETERS, ROWS, fit, normal_equations
from yawrate_env.compiled import LANES, over_blocks
from yawrate_env.signals.decimation import averaged

_START_RATE = 70.0  # rad/s, double pole of the first C: faster than the plant


class FitStatus(IntEnum):
    """How a fit ended; without a finite cost, or with a constant input or output, degenerate."""

    CONVERGED = 0
    NOT_CONVERGED = 1
    DEGENERATE = 2


@dataclass(frozen=True, slots=True, eq=False)
class ArmaxFit:
    """Models of B episodes.

    Attributes
    ----------
    theta : NDArray
        (B, 6) coefficients in the order of `PARAMETERS`.
    cost : NDArray
        (B,) mean squared one-step prediction error, in the unit of y squared.
    status : NDArray
        (B,) of `FitStatus`.
    passes : NDArray
        (B,) evaluations of cost and gradient.
    """

    theta: NDArray[np.float64]
    cost: NDArray[np.float64]
    status: NDArray[np.int64]
    passes: NDArray[np.int64]


def armax(u: NDArray[np.float64], y: NDArray[np.float64], Ts: float) -> ArmaxFit:
    """Fit one model to every episode.

    Parameters
    ----------
    u : (1, N) or (B, N) float64
        Inputs.
    y : (B, N) float64
        Outputs, from rest.
    Ts : float
        Sampling time [s]; it only sets the starting point.
    """
    count = len(y)
    theta, cost = np.empty((count, len(PARAMETERS))), np.empty(count)
    status, passes = np.empty(count, np.int64), np.empty(count, np.int64)
    pole = float(np.exp(-_START_RATE * Ts))

    def work(i: int, j: int) -> None:
        rows = np.minimum(np.arange(i, i + LANES), j - 1)
        inputs = u[rows] if len(u) > 1 else np.broadcast_to(u, (LANES, u.shape[1]))
        found = np.empty((LANES, len(PARAMETERS))), np.empty(LANES), np.empty((LANES, 2), np.int64)
        fit(inputs.T.ravel(), y[rows].T.ravel(), pole, *found)
        theta[i:j], cost[i:j] = found[0][: j - i], found[1][: j - i]
        status[i:j], passes[i:j] = found[2][: j - i].T

    over_blocks(work, count, LANES)
    status[(np.ptp(u, axis=1) == 0) | (np.ptp(y, axis=1) == 0)] = FitStatus.DEGENERATE
    return ArmaxFit(theta, cost / y.shape[1], status, passes)


def cost(
    theta: NDArray[np.float64], u: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Mean squared one-step prediction error of given models, (B, 6) to (B,)."""
    out = np.empty(len(y))
    work = np.zeros(ROWS * LANES)
    for i in range(len(y)):
        lanes = (np.repeat(a, LANES) for a in (u[i if len(u) > 1 else 0], y[i], theta[i]))
        inputs, outputs, work[: len(PARAMETERS) * LANES] = lanes
        normal_equations(inputs, outputs, work)
        out[i] = work[COST]
    return np.asarray(out / y.shape[1])


def simulated(theta: NDArray[np.float64], u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Response B/A u of models (B, 6) from rest, without noise; (1, N) or (B, N) to (B, N)."""
    a1, a2, b1, b2 = theta[:, :4].T
    y = np.zeros((len(theta), u.shape[1] + 2))
    inputs = np.pad(u, ((0, 0), (2, 0)))
    for k in range(2, y.shape[1]):
        y[:, k] = b1 * inputs[:, k - 1] + b2 * inputs[:, k - 2]
        y[:, k] -= a1 * y[:, k - 1] + a2 * y[:, k - 2]
    return np.asarray(y[:, 2:])


@dataclass(frozen=True, slots=True)
class Armax:
    """First stage: the six ARMAX coefficients of an episode.

    Attributes
    ----------
    Ts : float
        Sampling time of the model [s].  Episodes sampled faster are averaged over
        blocks first.  Two poles must stand for six, and at 25 Hz they are fitted to
        what matters near the crossover: from 1 kHz to 25 Hz the spread of the phase
        margin falls by nearly half for the network and to a fifth for the trees.
    """

    Ts: float = 0.04

    any_experiment: ClassVar[bool] = False
    one_pair: ClassVar[bool] = True

    @property
    def width(self) -> int:
        """Number of features."""
        return len(PARAMETERS)

    def __call__(
        self, u: NDArray[np.float64], y: NDArray[np.float64], Ts: float
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Features (B, 6) of episodes sampled at `Ts` [s], and which are usable (B,)."""
        block = round(self.Ts / Ts)
        if block < 1 or abs(block * Ts - self.Ts) > 1e-6 * self.Ts:
            raise ValueError(
                f"Ts = {Ts:g} s does not divide the ARMAX sampling time {self.Ts:g} s. "
                "Resample the episode, or train a tuner for this Ts."
            )
        if y.shape[1] // block < 10 * len(PARAMETERS):
            raise ValueError(
                f"{y.shape[1]} samples of {Ts:g} s leave {y.shape[1] // block} for six ARMAX "
                f"coefficients; at least {10 * len(PARAMETERS)} are needed. Record for longer."
            )
        found = armax(self.averaged(u, Ts), self.averaged(y, Ts), self.Ts)
        return found.theta, found.status == FitStatus.CONVERGED

    def averaged(self, x: NDArray[np.floating], Ts: float) -> NDArray[np.float64]:
        """Signals (B, N) sampled at `Ts` [s], as block averages at the model's sampling time."""
        return averaged(x, round(self.Ts / Ts))
