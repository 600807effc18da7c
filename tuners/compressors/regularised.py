"""First stage where every episode has another input: least squares that knows the simulations.

Each input leaves other combinations of Laguerre coefficients in the noise, and a learner that
sees the coefficients alone cannot know which.  Simulated plants have theirs in few directions
``W`` about a mean ``m``, so that ``c = m + W z`` with z of mean zero and variance one, and

    z = (W^T G W + s^2 I)^-1 W^T (b - G m)

is the best linear estimate of z, with ``G c = b`` the normal equations of the recording and
``s^2`` the variance that they leave over.  It is the regularised least squares of system
identification (Chen, Ohlsson and Ljung, 2012) with the simulator for a kernel: functions may
be many, and directions that the input did not excite are taken from the prior.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.compressors.laguerre import Laguerre, lifted, moved
from yawrate_env import validation

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Regularised:
    """Compressor: principal components of Laguerre coefficients.

    Attributes
    ----------
    order, pole
        Of the functions, as `Laguerre` has them.
    mean : tuple of float
        The simulated plants' mean coefficients (order,).
    directions : tuple of tuple of float
        (r, order) what one standard deviation along each of their principal components adds.
    """

    order: int
    pole: float
    mean: tuple[float, ...]
    directions: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        order = Laguerre(self.order, self.pole).order
        mean = validation.finite_array("mean", self.mean, shape=(order,))
        directions = validation.finite_array("directions", self.directions, shape=(None, order))
        if not len(directions) or np.linalg.matrix_rank(directions) < len(directions):
            raise ValueError(
                f"the {len(directions)} directions must be one or more of which none follows from "
                "the others. Leave out those that do."
            )
        # What is read from JSON has lists.
        object.__setattr__(self, "order", order)
        object.__setattr__(self, "mean", tuple(mean.tolist()))
        object.__setattr__(self, "directions", tuple(map(tuple, directions.tolist())))

    def __call__(self, u: Array, y: Array, Ts: float) -> tuple[Array, NDArray[np.bool_]]:
        """Features (B, r) of episodes sampled at `Ts` [s], and which are usable (B,)."""
        N, n = y.shape[1], self.order
        if N < 2 * n:
            raise ValueError(
                f"{N} samples are too few for {n} Laguerre coefficients; at least {2 * n} are "
                "needed. Record for longer."
            )
        m, W = np.array(self.mean), np.array(self.directions).T
        G, b = Laguerre(n, self.pole).normal_equations(u, y, Ts, np.empty((0, N)))
        G = lifted(G)
        left = np.einsum("bn,bn->b", y, y) - (b * _solve(G, b)).sum(axis=1)
        variance = np.maximum(left, 0.0) / (N - n)
        information = W.T @ G @ W + variance[:, None, None] * np.eye(W.shape[1])
        z = _solve(information, np.einsum("bn,nr->br", b - G @ m, W))
        found = np.isfinite(z).all(axis=1) & np.isfinite(variance)
        return z, np.asarray(found & moved(u))


def regularised(functions: Laguerre, coefficients: Array, smallest: float) -> Regularised:
    """The compressor whose prior is how simulated plants' coefficients (B, order) spread.

    Parameters
    ----------
    smallest : float
        Components that vary less than this part of the largest one are left out.
    """
    mean = coefficients.mean(axis=0)
    with np.errstate(invalid="ignore"):
        varied = np.ptp(coefficients, axis=0)
    if not (np.isfinite(varied).all() and varied.any()):
        raise ValueError(
            "the simulated plants' Laguerre coefficients are all the same, or no finite numbers: "
            "nothing can be learned from such inputs. Give some of ordinary size that excite."
        )
    _, spread, components = np.linalg.svd(coefficients - mean, full_matrices=False)
    kept = np.flatnonzero(spread > smallest * spread[0])
    spread, components = spread[kept] / np.sqrt(len(coefficients) - 1), components[kept]
    largest = np.take_along_axis(components, np.abs(components).argmax(axis=1)[:, None], axis=1)
    directions = components * np.sign(largest) * spread[:, None]
    return Regularised(
        functions.order, functions.pole, _rounded(mean), tuple(map(_rounded, directions))
    )


def _rounded(values: Array) -> tuple[float, ...]:
    """Nine digits: the last ones depend on the linear algebra library."""
    return tuple(float(f"{value:.9g}") for value in values)


def _solve(matrix: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])
