"""Levenberg and Marquardt's method for a network with one hidden layer of tanh.

Gauss-Newton steps with damping ``mu`` (Hagan and Menhaj, 1994) from weights by Nguyen and Widrow's
rule (1990).  With one hidden layer the Jacobian is written down directly, which is several times
faster than automatic differentiation.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from tuners.learners.batches import Progress

if TYPE_CHECKING:
    import torch

    Tensors = Iterable[tuple[torch.Tensor, torch.Tensor]]

Array = NDArray[np.float64]

_LEAST_GRADIENT = 1e-7
_ROWS = 1024
_MU_MAX = 1e10


class Steps(Protocol):
    """Settings of the steps, as `tuners.learners.feedforward.FeedForwardSettings` has them."""

    @property
    def epochs(self) -> int:
        """Largest number of steps."""

    @property
    def mu(self) -> float:
        """Damping at the start."""

    @property
    def mu_decrease(self) -> float:
        """Factor of the damping after a good step."""

    @property
    def mu_increase(self) -> float:
        """Factor of the damping after a bad step."""

    @property
    def max_fail(self) -> int:
        """Rises of the validation error in a row that end the training."""


def nguyen_widrow(n: int, neurons: int, outputs: int, rng: np.random.Generator) -> Array:
    """Initial weights, flat: hidden units spread evenly over the scaled inputs."""
    magnitude = 0.7 * neurons ** (1 / n)
    direction = rng.uniform(-1, 1, (neurons, n))
    W1 = magnitude * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    b1 = magnitude * np.linspace(-1, 1, neurons) * np.sign(W1[:, 0])
    W2 = rng.uniform(-1, 1, (outputs, neurons)) / np.sqrt(neurons)
    return np.concatenate([W1.ravel(), b1, W2.ravel(), np.zeros(outputs)])


def layers(
    weights: "torch.Tensor", shape: tuple[int, int, int]
) -> "tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]":
    """W1 (h, n), b1 (h,), W2 (o, h) and b2 (o,) of flat weights."""
    import torch

    n, h, o = shape
    W1, b1, W2, b2 = torch.split(weights, [h * n, h, o * h, o])
    return W1.reshape(h, n), b1, W2.reshape(o, h), b2


def _error(
    weights: "torch.Tensor", shape: tuple[int, int, int], x: "torch.Tensor", t: "torch.Tensor"
) -> "torch.Tensor":
    W1, b1, W2, b2 = layers(weights, shape)
    return (x @ W1.T + b1).tanh() @ W2.T + b2 - t


def _loss(weights: "torch.Tensor", shape: tuple[int, int, int], batches: "Tensors") -> float:
    """Mean squared error."""
    total, count = 0.0, 0
    for x, t in batches:
        error = _error(weights, shape, x, t)
        total, count = total + float((error**2).sum()), count + error.numel()
    return total / count


def _summed(
    weights: "torch.Tensor", shape: tuple[int, int, int], batches: "Tensors"
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
    W1, b1, W2, b2 = layers(weights, shape)
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


def train(
    weights: "torch.Tensor",
    shape: tuple[int, int, int],
    training: "Tensors",
    validation: "Tensors",
    settings: Steps,
    progress: Progress | None,
) -> "torch.Tensor":
    """Weights with the least validation error, from training batches of scaled tensors."""
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
