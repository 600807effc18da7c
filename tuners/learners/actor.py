"""A second stage that learned from rewards: the actor of an agent.

An agent observes standardised features and acts in [-1, 1]; the standardisation and the bounds
of the coordinates are saved with it.
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from yawrate_env.plant.parametrisation import scale_to_bounds
from yawrate_env.validation import count, finite_array

Array = NDArray[np.float64]

LIMIT = 10.0
"""Standardised features are clipped here, so that the observation space is finite."""

_PAIR = "weight", "bias"
_OTHERS = "mean", "scale", "low", "high"


def standardise(values: Array, mean: Array, scale: Array) -> NDArray[np.float32]:
    """Features (B, n) as an agent observes them."""
    return np.clip((values - mean) / scale, -LIMIT, LIMIT).astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class Actor:
    """A deterministic policy: a multilayer perceptron.

    Attributes
    ----------
    layers : list
        (weight (out, in), bias (out,)) pairs.
    hidden : {"relu", "tanh"}
        Activation between them.
    squashed : bool
        Whether the output goes through tanh; it is clipped to [-1, 1] otherwise.
    """

    layers: list[tuple[Array, Array]]
    hidden: str
    squashed: bool

    def __call__(self, features: NDArray[np.floating]) -> Array:
        """Features (B, n) to actions (B, m) in [-1, 1]."""
        x = np.asarray(features, dtype=np.float64)
        for i, (weight, bias) in enumerate(self.layers):
            if i:
                x = np.maximum(x, 0) if self.hidden == "relu" else np.tanh(x)
            x = x @ weight.T + bias
        return np.tanh(x) if self.squashed else np.clip(x, -1, 1)

    def arrays(self) -> dict[str, Array]:
        """``weight0``, ``bias0``, ``weight1``, ...."""
        pairs = enumerate(self.layers)
        return {f"{n}{i}": a for i, pair in pairs for n, a in zip(_PAIR, pair, strict=True)}

    @classmethod
    def of(cls, arrays: dict[str, NDArray[Any]], hidden: str, squashed: bool) -> Self:
        """Rebuild from `arrays`, among which there may be others.

        ``ValueError`` where these do not go together.
        """
        depth = sum(name.startswith("weight") for name in arrays)
        count("number of layers", depth, remedy="Give one or more.")
        layers, width = [], None
        for weight, bias in ((f"weight{i}", f"bias{i}") for i in range(depth)):
            rows = finite_array(weight, arrays[weight], shape=(None, width))
            finite_array(bias, arrays[bias], shape=(len(rows),))
            layers.append((arrays[weight], arrays[bias]))
            width = len(rows)
        return cls(layers, hidden, squashed)

    @property
    def widths(self) -> tuple[int, int]:
        """Numbers of features and of actions."""
        return self.layers[0][0].shape[1], len(self.layers[-1][1])


@dataclass(frozen=True, slots=True, eq=False)
class Agent:
    """An actor, with the standardisation of its features and the bounds of its actions.

    Attributes
    ----------
    actor : Actor
        Standardised features to actions.
    mean, scale : NDArray
        (n,) of the features.
    low, high : NDArray
        (m,) coordinates that -1 and 1 stand for.
    """

    actor: Actor
    mean: Array
    scale: Array
    low: Array
    high: Array

    @property
    def width(self) -> int:
        """Number of features."""
        return len(self.mean)

    def __call__(self, X: Array) -> Array:
        """Predict (B, m) coordinates from (B, n) features."""
        actions = self.actor(standardise(X, self.mean, self.scale))
        return scale_to_bounds(actions, self.low, self.high)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays to save."""
        return {
            **self.actor.arrays(),
            **{name: getattr(self, name) for name in _OTHERS},
            "tanh": np.array(self.actor.hidden == "tanh"),
            "squashed": np.array(self.actor.squashed),
        }

    @classmethod
    def from_arrays(cls, arrays: dict[str, NDArray[Any]]) -> Self:
        """Rebuild from `arrays`, or ``ValueError`` where these do not go together."""
        hidden = "tanh" if arrays["tanh"].item() else "relu"
        actor = Actor.of(arrays, hidden, bool(arrays["squashed"].item()))
        n, m = actor.widths
        for name, width in zip(_OTHERS, (n, n, m, m), strict=True):
            finite_array(name, arrays[name], shape=(width,))
        if not (arrays["scale"] > 0).all() or not (arrays["low"] < arrays["high"]).all():
            raise ValueError("scale must be positive, and low below high.")
        return cls(actor, *(arrays[name] for name in _OTHERS))
