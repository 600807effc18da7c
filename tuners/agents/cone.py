"""A critic that is a cone over the actions, and its fit by Levenberg and Marquardt's method.

    e(x, a) = sqrt(|L(x) (a - mu(x))|^2 + k^2)

is the error that action a earns at observation x.  The best action mu(x) comes from one hidden
layer of tanh, the lower triangular L(x), its diagonal positive, from a second; k is the error that
is left at the best action.  Normalised advantage functions (Gu et al., 2016) have the square
|L (a - mu)|^2 in this place, for rewards that are smooth at their maximum; rewards here are
distances from a target, so that the error itself is fitted, and a single one tells as much of
mu far away as near by.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_STEEPEST = 8.0  # largest logarithm of L's diagonal and of k
_ROWS = 4096  # of the Jacobian at a time
_DAMPING = 1e-2, 1e-9, 1e8  # first, least, largest
_SLOW = 1e-4  # relative improvement that ends the search when seen twice in a row


@dataclass(frozen=True, slots=True)
class Cone:
    """Shape of a critic; its weights are one flat array.

    Attributes
    ----------
    inputs, actions : int
        Numbers n and m in an observation and in an action.
    neurons : tuple of int
        Hidden units of mu and of L.
    """

    inputs: int
    actions: int
    neurons: tuple[int, int] = (12, 4)

    @property
    def entries(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows and columns of L's entries."""
        return np.tril_indices(self.actions)

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """Of mu's layers, of L's layers, and of log k."""
        (h, g), n, m, t = self.neurons, self.inputs, self.actions, len(self.entries[0])
        return (h, n), (h,), (m, h), (m,), (g, n), (g,), (t, g), (t,), (1,)

    @property
    def ends(self) -> Array:
        """Where each part of the weights ends."""
        return np.cumsum([np.prod(shape) for shape in self.shapes])

    def parts(self, weights: Array) -> list[Array]:
        """The weights in their `shapes`."""
        flat = np.split(weights, self.ends[:-1].astype(int))
        return [part.reshape(shape) for part, shape in zip(flat, self.shapes, strict=True)]

    def start(self, rng: np.random.Generator) -> Array:
        """Random weights: small actions, and the same steepness everywhere."""
        (h, g), n, m = self.neurons, self.inputs, self.actions
        row, column = self.entries
        parts = (
            rng.normal(size=(h, n)) / np.sqrt(n),
            rng.uniform(-1, 1, h),
            0.3 * rng.normal(size=(m, h)) / np.sqrt(h),
            np.zeros(m),
            0.5 * rng.normal(size=(g, n)) / np.sqrt(n),
            rng.uniform(-1, 1, g),
            np.zeros((len(row), g)),
            np.where(row == column, 1.0, 0.0),
            np.array([-3.0]),
        )
        return np.concatenate([part.ravel() for part in parts])

    def best(self, weights: Array, x: Array) -> Array:
        """The best actions mu (B, m) at observations (B, n)."""
        W, b, V, c, *_ = self.parts(weights)
        return np.asarray(np.tanh(x @ W.T + b) @ V.T + c)

    def factor(self, weights: Array, x: Array) -> Array:
        """L (B, m, m) at observations (B, n)."""
        *_, W, b, V, c, _ = self.parts(weights)
        return self._factor(np.tanh(x @ W.T + b) @ V.T + c)

    def errors(self, weights: Array, x: Array, a: Array) -> Array:
        """Errors e (B,) of actions (B, m) at observations (B, n)."""
        off = np.einsum("bij,bj->bi", self.factor(weights, x), a - self.best(weights, x))
        return np.asarray(np.sqrt((off**2).sum(axis=1) + _exp(2 * weights[-1])))

    def slopes(self, weights: Array, x: Array, a: Array) -> tuple[Array, Array]:
        """`errors` (B,), and their derivatives with respect to the weights (B, p)."""
        W, b, V, c, W2, b2, V2, c2, log_k = self.parts(weights)
        row, column = self.entries
        hidden, hidden2 = np.tanh(x @ W.T + b), np.tanh(x @ W2.T + b2)
        away, L = a - hidden @ V.T - c, self._factor(hidden2 @ V2.T + c2)
        off, k2 = np.einsum("bij,bj->bi", L, away), _exp(2 * log_k)
        e = np.sqrt((off**2).sum(axis=1) + k2)
        unit = off / e[:, None]
        to_mu = -np.einsum("bij,bi->bj", L, unit)
        to_L = unit[:, row] * away[:, column]
        to_L *= np.where(row == column, L[:, row, column], 1.0)
        J = np.empty((len(x), len(weights)))
        half, last = int(self.ends[3]), len(weights) - 1
        _layers(J[:, :half], to_mu, hidden, V, x)
        _layers(J[:, half:last], to_L, hidden2, V2, x)
        J[:, last] = k2 / e
        return e, J

    def _factor(self, entries: Array) -> Array:
        """L (B, m, m) from its entries, those on the diagonal as logarithms."""
        (row, column), m = self.entries, self.actions
        L = np.zeros((len(entries), m, m))
        L[:, row, column] = np.where(row == column, _exp(entries), entries)
        return L


def _exp(values: Array) -> Array:
    return np.asarray(np.exp(np.minimum(values, _STEEPEST)))


def _layers(J: Array, slope: Array, hidden: Array, V: Array, x: Array) -> None:
    """Derivatives (B, p) of W, b, V, c, from those of the output ``V tanh(W x + b) + c`` (B, o)."""
    B, h = hidden.shape
    n, o = x.shape[1], slope.shape[1]
    inner = (slope @ V) * (1 - hidden**2)
    at = np.cumsum([h * n, h, o * h])
    J[:, : at[0]] = (inner[:, :, None] * x[:, None, :]).reshape(B, -1)
    J[:, at[0] : at[1]] = inner
    J[:, at[1] : at[2]] = (slope[:, :, None] * hidden[:, None, :]).reshape(B, -1)
    J[:, at[2] :] = slope


def fit(
    cone: Cone, weights: Array, x: Array, a: Array, e: Array, weight: Array, steps: int
) -> tuple[Array, float]:
    """Least squares of ``weight * (cone - e)`` from a start (Levenberg 1944, Marquardt 1963).

    Parameters
    ----------
    weights : (p,) float64
        Where to start.
    x, a, e, weight : (N, n), (N, m), (N,), (N,) float64
        Observations, actions, their errors, and how much each counts.
    steps : int
        At most.

    Returns
    -------
    weights : (p,) float64
    cost : float
        Sum of squares.
    """
    damping, least, largest = _DAMPING
    cost, gradient, normal = _summed(cone, weights, x, a, e, weight)
    slow = 0
    for _ in range(steps):
        diagonal = np.diag(normal)
        scale = np.diag(diagonal + 1e-6 * diagonal.mean())
        while damping < largest:
            trial = weights - np.linalg.solve(normal + damping * scale, gradient)
            new = float((((cone.errors(trial, x, a) - e) * weight) ** 2).sum())
            if new < cost:
                break
            damping *= 4
        else:
            break
        slow = slow + 1 if cost - new < _SLOW * cost else 0
        weights, damping = trial, max(damping / 5, least)
        if slow == 2:
            return weights, new
        cost, gradient, normal = _summed(cone, weights, x, a, e, weight)
    return weights, cost


def _summed(
    cone: Cone, weights: Array, x: Array, a: Array, e: Array, weight: Array
) -> tuple[float, Array, Array]:
    """Sum of squares, half its gradient (p,) and its Gauss-Newton matrix (p, p)."""
    cost, gradient = 0.0, np.zeros(len(weights))
    normal = np.zeros((len(weights), len(weights)))
    for at in range(0, len(x), _ROWS):
        rows = slice(at, at + _ROWS)
        found, J = cone.slopes(weights, x[rows], a[rows])
        J *= weight[rows, None]
        off = (found - e[rows]) * weight[rows]
        cost += float(off @ off)
        gradient += J.T @ off
        normal += J.T @ J
    return cost, gradient, normal
