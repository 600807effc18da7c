"""Second stage: one hidden layer of tanh, trained by Levenberg and Marquardt's method.

What MATLAB's ``feedforwardnet`` and ``trainlm`` do with the paper's settings: inputs and
targets scaled to [-1, 1], weights started by Nguyen and Widrow's rule (1990), Gauss-Newton
steps with damping ``mu`` (Hagan and Menhaj, 1994), stop when the validation error has
risen so many times in a row, best weights kept.  With one hidden layer the Jacobian is
written down directly, which is several times faster than automatic differentiation.

PyTorch trains; the trained network is NumPy alone, so that using it does not import torch.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from tuners.learners.batches import Batches, Progress
from tuners.learners.threads import threads
from yawrate_env.compiled import cores
from yawrate_env.validation import count, finite_array, number

if TYPE_CHECKING:
    import torch

Array = NDArray[np.float64]

_NUMBERS_FOR_THREADS = 50_000
_LEAST_GRADIENT = 1e-7
_ROWS = 1024
_MU_MAX = 1e10


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
            weights = _train(weights, shape, fitted, checked, self, progress)
        W1, b1, W2, b2 = (layer.numpy() for layer in _layers(weights, shape))
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


def nguyen_widrow(n: int, neurons: int, outputs: int, rng: np.random.Generator) -> Array:
    """Initial weights, flat: hidden units spread evenly over the scaled inputs."""
    magnitude = 0.7 * neurons ** (1 / n)
    direction = rng.uniform(-1, 1, (neurons, n))
    W1 = magnitude * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    b1 = magnitude * np.linspace(-1, 1, neurons) * np.sign(W1[:, 0])
    W2 = rng.uniform(-1, 1, (outputs, neurons)) / np.sqrt(neurons)
    return np.concatenate([W1.ravel(), b1, W2.ravel(), np.zeros(outputs)])


def _layers(
    weights: "torch.Tensor", shape: tuple[int, int, int]
) -> "tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]":
    import torch

    n, h, o = shape
    W1, b1, W2, b2 = torch.split(weights, [h * n, h, o * h, o])
    return W1.reshape(h, n), b1, W2.reshape(o, h), b2


def _error(
    weights: "torch.Tensor", shape: tuple[int, int, int], x: "torch.Tensor", t: "torch.Tensor"
) -> "torch.Tensor":
    W1, b1, W2, b2 = _layers(weights, shape)
    return (x @ W1.T + b1).tanh() @ W2.T + b2 - t


def _loss(weights: "torch.Tensor", shape: tuple[int, int, int], batches: _Scaled) -> float:
    """Mean squared error."""
    total, count = 0.0, 0
    for x, t in batches:
        error = _error(weights, shape, x, t)
        total, count = total + float((error**2).sum()), count + error.numel()
    return total / count


def _summed(
    weights: "torch.Tensor", shape: tuple[int, int, int], batches: _Scaled
) -> "tuple[float, torch.Tensor, torch.Tensor]":
    """`normal_equations` of all rows."""
    rows, loss = 0, 0.0
    Je, JJ = weights.new_zeros(len(weights)), weights.new_zeros(len(weights), len(weights))
    for x, t in batches:
        parts = normal_equations(weights, shape, x, t)
        rows += len(x)
        share = len(x) / rows
        loss += (float(parts[0]) - loss) * share
        Je += (parts[1] - Je) * share
        JJ += (parts[2] - JJ) * share
    return loss, Je, JJ


def normal_equations(
    weights: "torch.Tensor", shape: tuple[int, int, int], x: "torch.Tensor", t: "torch.Tensor"
) -> "tuple[torch.Tensor, torch.Tensor, torch.Tensor]":
    """Mean squared error, half its gradient, and its Gauss-Newton matrix J'J/(m o).

    Every output has the same Jacobian ``Z = [slope x, slope, hidden, 1]``, but for the weights
    that scale the columns of W1 and b1.  ``Z'Z`` and ``Z'e`` are therefore summed once, in
    blocks that fit the cache, and scaled afterwards.
    """
    import torch

    n, h, o = shape
    W1, b1, W2, b2 = _layers(weights, shape)
    first, width = h * n + h, h * n + 2 * h + 1
    ZZ, Ze = weights.new_zeros(width, width), weights.new_zeros(width, o)
    squares = weights.new_zeros(())
    for inputs, targets in zip(torch.split(x, _ROWS), torch.split(t, _ROWS), strict=True):
        hidden = (inputs @ W1.T + b1).tanh()
        error = hidden @ W2.T + b2 - targets
        slope = 1 - hidden**2
        outer = (slope[:, :, None] * inputs[:, None, :]).reshape(-1, h * n)
        Z = torch.cat([outer, slope, hidden, hidden.new_ones(len(hidden), 1)], dim=1)
        ZZ.addmm_(Z.T, Z)
        Ze.addmm_(Z.T, error)
        squares += (error**2).sum()
    unit = torch.cat([torch.arange(h).repeat_interleave(n), torch.arange(h)])
    scale = W2[:, unit]  # (o, first)
    JJ = weights.new_zeros(len(weights), len(weights))
    JJ[:first, :first] = scale.T @ scale * ZZ[:first, :first]
    for k in range(o):
        own = torch.cat([first + k * h + torch.arange(h), torch.tensor([first + o * h + k])])
        JJ[:first, own] = scale[k, :, None] * ZZ[:first, first:]
        JJ[own, :first] = JJ[:first, own].T
        JJ[own[:, None], own] = ZZ[first:, first:]
    to_first = (scale.T * Ze[:first]).sum(dim=1)
    Je = torch.cat([to_first, Ze[first:-1].T.ravel(), Ze[-1]])
    count = len(x) * o
    return squares / count, Je / count, JJ / count


def _train(
    weights: "torch.Tensor",
    shape: tuple[int, int, int],
    training: _Scaled,
    validation: _Scaled,
    settings: FeedForwardSettings,
    progress: Progress | None,
) -> "torch.Tensor":
    import torch

    mu, fails, done = settings.mu, 0, 0
    best, best_error = weights, _loss(weights, shape, validation)
    eye = torch.eye(len(weights), dtype=weights.dtype)
    while done < settings.epochs:
        loss, Je, JJ = _summed(weights, shape, training)
        if 2 * Je.norm() < _LEAST_GRADIENT:
            break
        while mu <= _MU_MAX:
            factor, info = torch.linalg.cholesky_ex(JJ + mu * eye)
            if info == 0:
                trial = weights - torch.cholesky_solve(Je[:, None], factor)[:, 0]
                if _loss(trial, shape, training) < loss:
                    weights, mu = trial, mu * settings.mu_decrease
                    break
            mu *= settings.mu_increase
        else:
            break
        error = _loss(weights, shape, validation)
        if error < best_error:
            best, best_error, fails = weights, error, 0
        else:
            fails += 1
        done += 1
        if progress is not None:
            progress(done, settings.epochs)
        if fails >= settings.max_fail:
            break
    if progress is not None and 0 < done < settings.epochs:
        progress(done, done)  # it goes no further
    return best
