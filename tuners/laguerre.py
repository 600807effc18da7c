"""First stage, the alternative: linear least squares on Laguerre functions.

The output is regressed on the input filtered by the discrete Laguerre functions
(Wahlberg, 1991) with pole ``a = exp(-pole Ts)``,

    L_1 = sqrt(1 - a^2)/(q - a),   L_{i+1} = L_i (1 - a q)/(q - a),

which span the impulse responses of stable systems and are orthonormal.  The fit is
one linear problem without local minima, and the coefficients are the features.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import kernel, over_blocks

Array = NDArray[np.float64]

_SERIAL = 2**18  # multiplications for which OpenBLAS does not yet call its other threads
_EPISODES = 16


@dataclass(frozen=True, slots=True)
class Laguerre:
    """Compressor: coefficients on Laguerre functions.

    Attributes
    ----------
    order : int
        Number of functions.
    pole : float
        Their common pole, continuous [rad/s].
    """

    order: int = 10
    pole: float = 12.0

    def __call__(self, u: Array, y: Array, Ts: float) -> tuple[Array, NDArray[np.bool_]]:
        """Features (B, order) of episodes sampled at `Ts` [s], and which are usable (B,)."""
        if y.shape[1] < 10 * self.order:
            raise ValueError(
                f"{y.shape[1]} samples are too few for {self.order} Laguerre coefficients; "
                f"at least {10 * self.order} are needed. Record for longer."
            )
        values = np.empty((len(y), self.order))
        if len(u) == 1:
            phi = self.regressors(u, Ts)[0]
            matrix = self._normal_matrix(phi)

        def shared(i: int, j: int) -> None:
            values[i:j] = np.linalg.solve(matrix, _products(phi, y[i:j])).T

        def own(i: int, j: int) -> None:
            phi = self.regressors(u[i:j], Ts)[0]
            values[i:j] = np.linalg.solve(self._normal_matrix(phi), _products(phi, y[i:j])).T

        if len(u) == 1:
            over_blocks(shared, len(y), _EPISODES)
        else:
            over_blocks(own, len(y), 1)
        return values, np.asarray(np.isfinite(values).all(axis=1) & u.any(axis=1))

    def _normal_matrix(self, phi: Array) -> Array:
        """Left side of the normal equations for regressors (order, N).

        Orthonormal functions and a broad-band input keep it well conditioned, and it is
        several times faster than a decomposition of the regressors.
        """
        gram = _products(phi, phi)
        ridge = 1e-14 * np.trace(gram) or 1.0  # an input of zeros has no solution at all
        return np.asarray(gram + ridge * np.eye(self.order))

    def regressors(self, u: Array, Ts: float) -> Array:
        """Filtered inputs, (E, order, N)."""
        out = np.empty((len(u), self.order, u.shape[1]))
        for row, filtered in zip(u, out, strict=True):
            _filter(np.ascontiguousarray(row), float(np.exp(-self.pole * Ts)), filtered)
        return out


def _products(a: Array, b: Array) -> Array:
    """``a @ b.T`` of long rows, in parts so small that BLAS does not share them out.

    Its threads wait for each other: on a busy machine that took 300 times as long as the
    work.  `over_blocks` shares out whole episodes instead.
    """
    step = max(_SERIAL // (len(a) * len(b)), 1)
    out = np.zeros((len(a), len(b)))
    for k in range(0, a.shape[1], step):
        out += a[:, k : k + step] @ b[:, k : k + step].T
    return out


@kernel
def _filter(u: NDArray[np.float64], a: float, out: NDArray[np.float64]) -> None:
    order = len(out)
    gain = np.sqrt(1.0 - a * a)
    for k in range(1, len(u)):
        out[0, k] = a * out[0, k - 1] + gain * u[k - 1] if k > 1 else gain * u[0]
        for i in range(1, order):
            previous = out[i, k - 1] if k > 1 else 0.0
            delayed = out[i - 1, k - 1] if k > 1 else 0.0
            out[i, k] = a * previous + delayed - a * out[i - 1, k]
    for i in range(order):
        out[i, 0] = 0.0
