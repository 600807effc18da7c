"""Feedback of all states, and the reference's gain that makes the steady output the reference."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.feedback import Compensator, Feedback
from yawrate_env.loop.target import Target
from yawrate_env.loop.transfer_function import TransferFunction

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

STATE_FEEDBACK = "state feedback"


@dataclass(frozen=True, slots=True)
class StateFeedback:
    """Feedback of the plant's n states, of gains of either sign, and a gain of the reference.

    Attributes
    ----------
    states : tuple of str
        Names of the states' gains; the reference's is kr.
    """

    states: tuple[str, ...]
    name: str = STATE_FEEDBACK

    @property
    def gains(self) -> tuple[str, ...]:
        """Names of its gains, kr the last."""
        return *self.states, "kr"

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Gains of either sign."""
        return ("signed",) * len(self.gains)

    @property
    def rules(self) -> tuple[str, ...]:
        """LQR."""
        return ("lqr",)

    def usable(self, gains: Array) -> Flags:
        """Gains that are finite."""
        return np.asarray(np.isfinite(gains).all(axis=1))

    def shape(
        self, log_magnitude: Array, phase: Array, target: Target
    ) -> tuple[Array, NDArray[np.int64]]:
        """Refused: a response at one frequency does not tell the gains."""
        raise ValueError("loop shaping is for a PID or a lead-lag. Choose rule = 'lqr'.")

    def open_loop(self, plant: DiscretePlant, gains: Array, delay_samples: int) -> TransferFunction:
        """From the plant's input to what is fed back."""
        self._check(plant)
        seen = DiscretePlant(plant.A, plant.B, gains[:, :-1], plant.Ts)
        return TransferFunction.of(seen, delay_samples)

    def close(self, plant: DiscretePlant, gains: Array, delay_samples: int) -> Feedback:
        """As `Controller` says."""
        self._check(plant)
        one = np.ones((len(gains), 1))
        made = Compensator(gains[:, -1:], one, one)
        return Feedback.of(plant, made, delay_samples, gains[:, :-1])

    def _check(self, plant: DiscretePlant) -> None:
        if plant.delay is not None:
            raise ValueError("a state feedback needs a plant without dead time. Choose a PID.")
        if plant.A.shape[1] != len(self.states):
            raise ValueError(
                f"a state feedback with gains {', '.join(self.states)} is for a plant of as many "
                f"states, not of {plant.A.shape[1]}. Name a gain for each state."
            )


def reference_gain(plant: DiscretePlant, K: Array) -> Array:
    """Kr (B,), with which the steady output is the reference, of a state feedback (B, n)."""
    steady = np.eye(K.shape[1]) - plant.A + plant.B[:, :, None] * K[:, None, :]
    states = np.einsum("bij,bj->bi", np.linalg.pinv(steady), plant.B)
    with np.errstate(divide="ignore"):
        return np.asarray(1 / (states @ plant.C))
