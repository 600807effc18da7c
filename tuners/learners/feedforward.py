"""Second stage: one hidden layer of tanh, trained by Levenberg and Marquardt's method.

What MATLAB's ``feedforwardnet`` and ``trainlm`` do with the paper's settings: inputs and
targets scaled to [-1, 1], steps of `tuners.learners.levenberg_marquardt`, stop when the validation
error has risen so many times in a row, best weights kept.

PyTorch trains; the trained network is NumPy alone, so that using it does not import torch.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from tuners.learners.batches import Batches, Progress
from tuners.learners.levenberg_marquardt import layers, nguyen_widrow, train
from tuners.learners.threads import threads
from yawrate_env.compiled import cores
from yawrate_env.validation import count, finite_array, number

if TYPE_CHECKING:
    import torch

Array = NDArray[np.float64]

_NUMBERS_FOR_THREADS = 50_000


@dataclass(frozen=True, slots=True)
class FeedForwardSettings:
    """Hyperparameters, the paper's (section V-D).

    Attributes
    ----------
    neurons : int
        In the hidden layer.
    epochs : int
        At most.
    mu, mu_decrease, mu_increase : float
        Damping at the start, and its factors after a good and a bad step.
    max_fail : int
        Rises of the validation error in a row that end the training.
    """

    neurons: int = 10
    epochs: int = 1000
    mu: float = 0.001
    mu_decrease: float = 0.1
    mu_increase: float = 10.0
    max_fail: int = 5

    def __post_init__(self) -> None:
        for name, least in (("neurons", 1), ("epochs", 0), ("max_fail", 1)):
            count(name, getattr(self, name), at_least=least, remedy="The paper's are 10, 1000, 5.")
        remedy = "The paper's are 0.001, 0.1 and 10."
        number("mu", self.mu, above=0.0, remedy=remedy)
        number("mu_decrease", self.mu_decrease, above=0.0, below=1.0, remedy=remedy)
        number("mu_increase", self.mu_increase, above=1.0, remedy=remedy)

    def fit(
        self,
        training: Batches,
        validation: Batches,
        random_state: int,
        progress: Progress | None = None,
    ) -> "FeedForward":
        """Train on batches of (m, n) features and (m, t) targets.

        Error, gradient and Gauss-Newton matrix are means over rows, so that several batches
        give what one does, to rounding, in the memory that the largest takes.
        """
        import torch

        rows, *scaling = _scalings(training)
        n, outputs = (len(scale.middle) for scale in scaling)
        shape = (n, self.neurons, outputs)
        fitted, checked = _Scaled(training, *scaling), _Scaled(validation, *scaling)
        rng = np.random.default_rng(random_state)
        weights = torch.from_numpy(nguyen_widrow(n, self.neurons, outputs, rng))
        with threads(1 if rows * n < _NUMBERS_FOR_THREADS else cores()):
            weights = train(weights, shape, fitted, checked, self, progress)
        W1, b1, W2, b2 = (layer.numpy() for layer in layers(weights, shape))
        return FeedForward(W1, b1, W2, b2, *scaling)


@dataclass(frozen=True, slots=True, eq=False)
class _Scaling:
    """Affine map of each column's range onto [-1, 1]; constant columns go to 0."""

    middle: Array
    half: Array

    @classmethod
    def of(cls, low: Array, high: Array) -> Self:
        half = np.where(high > low, (high - low) / 2, 1.0)
        return cls((low + high) / 2, half)

    def __call__(self, values: Array) -> Array:
        return (values - self.middle) / self.half

    def inverse(self, scaled: Array) -> Array:
        return scaled * self.half + self.middle


def _scalings(batches: Batches) -> tuple[int, _Scaling, _Scaling]:
    """Rows, and the scaling of features and of targets."""
    rows, ends = 0, []
    for pair in batches:
        rows += len(pair[0])
        ends.append([(side.min(axis=0), side.max(axis=0)) for side in pair])
    X, T = (
        _Scaling.of(np.min([low for low, _ in side], axis=0), np.max([h for _, h in side], axis=0))
        for side in zip(*ends, strict=True)
    )
    return rows, X, T


@dataclass(frozen=True, slots=True, eq=False)
class _Scaled:
    """Batches as scaled tensors."""

    batches: Batches
    inputs: _Scaling
    outputs: _Scaling

    def __iter__(self) -> "Iterator[tuple[torch.Tensor, torch.Tensor]]":
        import torch

        for X, T in self.batches:
            yield torch.from_numpy(self.inputs(X)), torch.from_numpy(self.outputs(T))


@dataclass(frozen=True, slots=True, eq=False)
class FeedForward:
    """A trained network.

    Attributes
    ----------
    W1, b1 : NDArray
        (neurons, n) and (neurons,).
    W2, b2 : NDArray
        (t, neurons) and (t,).
    inputs, outputs : _Scaling
        How features and targets are scaled.
    """

    W1: Array
    b1: Array
    W2: Array
    b2: Array
    inputs: _Scaling
    outputs: _Scaling

    @property
    def width(self) -> int:
        """Number of features."""
        return int(self.W1.shape[1])

    def __call__(self, X: Array) -> Array:
        """Predict (B, t) targets from (B, n) features."""
        hidden = np.tanh(self.inputs(X) @ self.W1.T + self.b1)
        return self.outputs.inverse(hidden @ self.W2.T + self.b2)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays to save."""
        return {
            "W1": self.W1,
            "b1": self.b1,
            "W2": self.W2,
            "b2": self.b2,
            "inputs.middle": self.inputs.middle,
            "inputs.half": self.inputs.half,
            "outputs.middle": self.outputs.middle,
            "outputs.half": self.outputs.half,
        }

    @classmethod
    def from_arrays(cls, arrays: dict[str, NDArray[Any]]) -> Self:
        """Rebuild from `arrays`, or ``ValueError`` where these do not go together."""
        n, h, o = (len(arrays[name]) for name in ("inputs.middle", "b1", "b2"))
        shapes: dict[str, tuple[int, ...]] = {"W1": (h, n), "b1": (h,), "W2": (o, h), "b2": (o,)}
        for side, width in (("inputs", n), ("outputs", o)):
            shapes |= {f"{side}.middle": (width,), f"{side}.half": (width,)}
        for name, shape in shapes.items():
            finite_array(name, arrays[name], shape=shape)
        inputs, outputs = (
            _Scaling(arrays[f"{side}.middle"], arrays[f"{side}.half"])
            for side in ("inputs", "outputs")
        )
        return cls(
            arrays["W1"], arrays["b1"], arrays["W2"], arrays["b2"], inputs=inputs, outputs=outputs
        )
