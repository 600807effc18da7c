"""Simulator, design rule and judge of linear plants in a PI loop.

The project's own: exact zero-order hold, the loop-shaping rule of `yawrate_env.design`,
margins of the sampled loop.  The plants are python-control models, one for each row of
parameters, or batches of matrices.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env import simulation
from yawrate_env.discretisation import DiscretePlant, zoh
from yawrate_env.judge import Judge
from yawrate_env.loop import TransferFunction
from yawrate_env.task import Target

Array = NDArray[np.float64]

GAINS = ("kp", "Ti")
FIGURES = {"phase margin [deg]": 10.0, "crossover [Hz]": 0.25}
"""With the errors that count as one in the yaw-rate environment."""


@dataclass(frozen=True, slots=True)
class PILoop:
    """What a `Plant` needs beside its prior and experiment.

    Attributes
    ----------
    discrete : callable
        ``discrete(theta, Ts)``: parameters (B, p) to B plants at a sampling time [s].
    Ts : float
        Sampling time of the experiment [s].
    target : Target
        What the loop must do, and the controller's sampling time.
    """

    discrete: Callable[[Array, float], DiscretePlant]
    Ts: float
    target: Target

    @classmethod
    def of(cls, model: Callable[[Array], Any], Ts: float, target: Target) -> Self:
        """Loop of a continuous python-control model ``model(theta)``, one plant at a time."""
        return cls(_Modelled(model), Ts, target)

    def simulate(self, theta: Array, u: Array, rng: Any) -> Array:
        """Noise-free outputs (B, N) from rest."""
        return simulation.simulate(self.discrete(theta, self.Ts), u)

    def design(self, theta: Array) -> Array:
        """(kp, Ti) (B, 2) that reach the target; ``nan`` where no PI does."""
        found = self._judge(theta).oracle()
        return np.stack([found.kp, found.Ti], axis=1)

    def judge(self, theta: Array, gains: Array) -> Array:
        """Phase margin [deg] and crossover [Hz], (B, 2)."""
        verdict = self._judge(theta)(*gains.T)
        found = np.stack([verdict.margins.phase_margin, verdict.margins.crossover], axis=1)
        found = np.where(np.isfinite(found), found, np.inf)
        return np.where(verdict.stable[:, None], found, np.nan)

    def _judge(self, theta: Array) -> Judge:
        plant = self.discrete(theta, self.target.Ts)
        return Judge(plant, TransferFunction.of(plant, self.target.delay_samples), self.target)


@dataclass(frozen=True, slots=True)
class _Modelled:
    """Models of one plant at a time, discretised."""

    model: Callable[[Array], Any]

    def __call__(self, theta: Array, Ts: float) -> DiscretePlant:
        return zoh(*_state_space([self.model(row) for row in theta]), Ts)


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
