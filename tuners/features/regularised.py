"""First stage for inputs that differ between episodes: least squares regularised by simulations.

Each input leaves other combinations of Laguerre coefficients in the noise, and a learner that
sees the coefficients alone cannot know which.  Simulated plants have theirs in few directions
``W`` about a mean ``m``, so that ``c = m + W z`` with z of mean zero and variance one.  With
``G c = b`` the normal equations of the recording,

    z = (W^T G W + s^2 I)^-1 W^T (b - G m)

is the best linear estimate of z, where ``s^2`` is the noise's variance.  It is the
regularised least squares of system identification (Chen, Ohlsson and Ljung, 2012) with the
simulator for a kernel: functions may be many, and what the input did not excite is taken
from the prior.

The learner knows features that are drawn to the prior as much as the simulated ones are.  So
directions that noise hides are left out, and ``s^2`` is that of the simulations: a stronger or
quieter recording is answered as well as usual, a longer one with up to twice the usual error.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre import Laguerre, excites, lifted
from yawrate_env import validation

Array = NDArray[np.float64]

_LEAST = 0.02  # information on a component, where its own variance and the noise's are one
_DIGITS = 1e-4  # of the largest component's spread: others are rounding


@dataclass(frozen=True, slots=True)
class Regularised:
    """First stage: principal components of Laguerre coefficients.

    Attributes
    ----------
    order, pole
        Of the functions, as `Laguerre` has them.
    mean : tuple of float
        The simulated plants' mean coefficients (order,).
    directions : tuple of tuple of float
        (r, order) what one standard deviation along each of their principal components adds.
    variance : float
        Of the simulated noise.
    """

    order: int
    pole: float
    mean: tuple[float, ...]
    directions: tuple[tuple[float, ...], ...]
    variance: float

    any_experiment: ClassVar[bool] = False
    one_pair: ClassVar[bool] = True

    def __post_init__(self) -> None:
        order = Laguerre(self.order, self.pole).order
        mean = validation.finite_array("mean", self.mean, shape=(order,))
        directions = validation.finite_array("directions", self.directions, shape=(None, order))
        if not len(directions) or np.linalg.matrix_rank(directions) < len(directions):
            raise ValueError(
                f"the {len(directions)} directions must be one or more of which none follows from "
                "the others. Leave out those that do."
            )
        validation.number("variance", self.variance, at_least=0.0, remedy="Give the noise's.")
        # What is read from JSON has lists.
        object.__setattr__(self, "order", order)
        object.__setattr__(self, "mean", tuple(mean.tolist()))
        object.__setattr__(self, "directions", tuple(map(tuple, directions.tolist())))

    @property
    def width(self) -> int:
        """Number of features."""
        return len(self.directions)

    def __call__(self, u: Array, y: Array, Ts: float) -> tuple[Array, NDArray[np.bool_]]:
        """Features (B, r) of episodes sampled at `Ts` [s], and which are usable (B,)."""
        N = y.shape[1]
        if N < 2 * self.order:
            raise ValueError(
                f"{N} samples are too few for {self.order} Laguerre coefficients; at least "
                f"{2 * self.order} are needed. Record for longer."
            )
        G, b = self.functions.normal_equations(u, y, Ts, np.empty((0, N)))
        W = np.array(self.directions)
        right = np.einsum("bn,rn->br", b - G @ np.array(self.mean), W)
        z = _solved(self._information(G), right)
        return z, np.asarray(np.isfinite(z).all(axis=1) & excites(u))

    def linear(self, gram: Array) -> tuple[Array, Array]:
        """K (r, order) and k (r,) in ``z = K b - k``, for one Gram matrix (order, order)."""
        K = np.linalg.solve(self._information(gram), np.array(self.directions))
        return K, K @ gram @ np.array(self.mean)

    @property
    def functions(self) -> Laguerre:
        """The Laguerre basis."""
        return Laguerre(self.order, self.pole)

    def _information(self, gram: Array) -> Array:
        """Left side (..., r, r) of the components' equations, of Gram matrices."""
        W = np.array(self.directions)
        return lifted(W @ gram @ W.T + self.variance * np.eye(len(W)))


def regularised(functions: Laguerre, gram: Array, right: Array, variance: Array) -> Regularised:
    """The first stage that knows how simulated plants' coefficients spread.

    Parameters
    ----------
    functions : Laguerre
        Whose coefficients are meant.
    gram, right : (B, order, order), (B, order) float64
        Normal equations of noise-free recordings.
    variance : (B,) float64
        Of the noise that they would have.
    """
    coefficients = _solved(lifted(gram), right)
    with np.errstate(invalid="ignore"):
        varied = np.ptp(coefficients, axis=0)
    if not (np.isfinite(varied).all() and varied.any()):
        raise ValueError(
            "the simulated plants' Laguerre coefficients are all the same, or no finite numbers: "
            "nothing can be learned from such inputs. Give some of ordinary size that excite."
        )
    mean, directions = coefficients.mean(axis=0), components(coefficients)
    kept = _informative(gram, directions, variance)
    return Regularised(
        functions.order, functions.pole, rounded(mean), tuple(map(rounded, directions[:kept])),
        *rounded(np.median(variance, keepdims=True)),
    )  # fmt: skip


def components(coefficients: Array) -> Array:
    """Principal directions (r, n) of coefficients (B, n), of one standard deviation each."""
    _, spread, rows = np.linalg.svd(coefficients - coefficients.mean(axis=0), full_matrices=False)
    kept = np.flatnonzero(spread > _DIGITS * spread[0])
    spread, rows = spread[kept] / np.sqrt(len(coefficients) - 1), rows[kept]
    largest = np.take_along_axis(rows, np.abs(rows).argmax(axis=1)[:, None], axis=1)
    return np.asarray(rows * np.sign(largest) * spread[:, None])


def _informative(gram: Array, directions: Array, variance: Array) -> int:
    """Number of leading components that a recording informs on, each given those before it."""
    A = np.einsum("bij,ri,sj->brs", gram, directions, directions)
    for i in range(len(directions)):
        pivot = A[:, i, i]
        with np.errstate(divide="ignore", invalid="ignore"):  # inputs of zeros, or no noise
            ratio = np.median(pivot / variance)
            A = A - A[:, :, i, None] * A[:, None, i, :] / pivot[:, None, None]
        if not ratio > _LEAST:
            return max(i, 1)
    return len(directions)


def rounded(values: Array) -> tuple[float, ...]:
    """Nine digits: the last ones depend on the linear algebra library."""
    return tuple(float(f"{value:.9g}") for value in values)


def _solved(matrix: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])
