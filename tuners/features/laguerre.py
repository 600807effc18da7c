"""First stage: linear least squares on Laguerre functions.

The output is regressed on the input filtered by the discrete Laguerre functions
(Wahlberg, 1991) with pole ``a = exp(-pole Ts)``,

    L_1 = sqrt(1 - a^2)/(q - a),   L_{i+1} = L_i (1 - a q)/(q - a),

which span the impulse responses of stable systems and are orthonormal.  The fit is
one linear problem without local minima, and the coefficients are the features.

Episodes with one input share their regressors: all that is left is one product that
waits for memory.  Where every episode has an input of its own, one pass over the data
filters and sums ``LANES`` episodes side by side, and no regressor is stored.  Of their
Gram matrix it sums the first row alone.  The all-pass sections are lossless, so that the
signals of two sections differ in their inner product by what the sections still hold,

    <phi_{i+1}, phi_{j+1}> = <phi_i, phi_j> - s_i s_j,  s_i = (a phi_{i+1} + phi_i)/sqrt(1 - a^2),

with s after the last sample; for eight functions that halves the pass.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre_passes import averages_of, filtered, outputs, sums_of
from yawrate_env import validation
from yawrate_env.compiled import LANES, over_blocks

Array = NDArray[np.float64]

_SERIAL, _SERIAL_ROW = 2**18, 9_000  # multiplications that OpenBLAS does not share out yet
_EPISODES = 16
_FEW = 4  # inputs, for which lanes do not pay
_LARGEST_KEPT = 2**18  # numbers: the experiment of an environment, asked about again and again


@dataclass(frozen=True, slots=True)
class Laguerre:
    """First stage: coefficients on Laguerre functions.

    Attributes
    ----------
    order : int
        Number of functions.
    pole : float
        Their common pole, continuous [rad/s].
    """

    order: int = 10
    pole: float = 12.0

    any_experiment: ClassVar[bool] = False

    def __post_init__(self) -> None:
        order = validation.count("order", self.order, remedy="Use some functions.")
        object.__setattr__(self, "order", order)
        validation.number("pole", self.pole, above=0.0, remedy="Give it in rad/s.")

    @property
    def width(self) -> int:
        """Number of features."""
        return self.order

    def __call__(self, u: Array, y: Array, Ts: float) -> tuple[Array, NDArray[np.bool_]]:
        """Features (B, order) of episodes sampled at `Ts` [s], and which are usable (B,).

        Of m inputs (1 or B, m, N) and q outputs (B, q, N) they are (B, q m order), those of the
        first output first, and of the first input first among these.
        """
        N, least = y.shape[-1], 10 * self.order * (u.shape[1] if u.ndim == 3 else 1)
        if least > N:
            raise ValueError(
                f"{N} samples are too few for {least // 10} Laguerre coefficients; "
                f"at least {least} are needed. Record for longer."
            )
        values = self.coefficients(u, y.reshape(-1, N), Ts, np.empty((0, N))).reshape(len(y), -1)
        return values, np.asarray(np.isfinite(values).all(axis=1) & excites(u))

    def coefficients(self, u: Array, y: Array, Ts: float, extra: Array) -> Array:
        """Least-squares coefficients on the functions, then on `extra` signals.

        Parameters
        ----------
        extra : (E, N) float64
            Further regressors, the same for every episode.

        Returns
        -------
        (B, order + E) float64
        """
        gram, right = self.normal_equations(u, y, Ts, extra)
        return np.asarray(np.linalg.solve(lifted(gram), right[..., None])[..., 0])

    def frequency_response(self, omega: Array, Ts: float) -> NDArray[np.complex128]:
        """Response of every function at `omega` [rad/s], (order, F)."""
        a, z = self._discrete_pole(Ts), np.exp(1j * omega * Ts)
        section = (1 - a * z) / (z - a)
        first = np.sqrt(1 - a * a) / (z - a)
        return np.asarray(first * section ** np.arange(self.order)[:, None])

    def held_response(self, omega: Array, Ts: float, hold: float) -> NDArray[np.complex128]:
        """Responses at `omega` [rad/s] of the functions sampled every `hold` [s], (order, F).

        The input is held as long.  For whole multiples of `Ts` all frequencies that sampling
        folds onto `omega` are summed; else the two holds' own responses make the difference.
        """
        times = round(hold / Ts)
        if times < 1 or abs(times * Ts - hold) > 1e-6 * hold:
            slow, fast = (-np.expm1(-1j * omega * T) / T for T in (hold, Ts))
            return np.asarray(self.frequency_response(omega, Ts) * slow / fast)
        folded = omega + 2 * np.pi / hold * np.arange(times)[:, None]
        held = np.exp(-1j * folded[..., None] * Ts * np.arange(times)).mean(axis=-1)
        responses = self.frequency_response(folded.ravel(), Ts).reshape(self.order, times, -1)
        return np.asarray((responses * held).sum(axis=1))

    def outputs(self, u: Array, weights: Array, Ts: float) -> Array:
        """Outputs (B, m, N) of m models each, weights (B, m, order), for inputs (1 or B, N)."""
        if len(u) == 1:
            rows = combined(weights.reshape(-1, weights.shape[2]), self._shared(u, Ts)[0])
            return rows.reshape(*weights.shape[:2], -1)
        if u.ndim == 3:
            pairs = zip(u[:, None], weights[:, None], strict=True)
            return np.concatenate([self.outputs(own, some, Ts) for own, some in pairs])
        driven, a = self.driven(u, Ts), self._discrete_pole(Ts)
        weights = np.ascontiguousarray(weights)
        found = np.zeros((*weights.shape[:2], u.shape[1]))
        state = np.empty(weights.shape[2])
        over_blocks(lambda i, j: outputs(driven[i:j], weights[i:j], a, state.copy(), found[i:j]),
                    len(weights), LANES)  # fmt: skip
        return found

    def normal_equations(
        self, u: Array, y: Array, Ts: float, extra: Array, orthonormal: bool = False
    ) -> tuple[Array, Array]:
        """Both sides, (1 or B, order + E, order + E) and (B, order + E); as for `coefficients`.

        Of several inputs (1 or R, m, N) the functions are m order.  Outputs (R, N) that follow
        each other have the same inputs where there are more outputs than those.  Inner products
        of extra signals that are orthonormal need not be summed.
        """
        inner = np.eye(len(extra)) if orthonormal else products(extra, extra)
        if u.ndim == 3 and len(u) > 1:
            each = len(y) // len(u)
            rows = zip(u[:, None], y.reshape(len(u), each, -1), strict=True)
            sides = [self.normal_equations(own, some, Ts, extra, orthonormal) for own, some in rows]
            gram, right = (np.concatenate(side) for side in zip(*sides, strict=True))
            return gram.repeat(each, axis=0), right
        if len(u) > 1:
            return self._own_inputs(u, y, Ts, extra, inner)
        phi, gram = self._shared(u, Ts)
        if len(extra):
            across = products(phi, extra)
            gram = np.block([[gram, across], [across.T, inner]])
            phi = np.concatenate([phi, extra])
        return gram[None], _right_sides(phi, y)

    def loads(self, N: int) -> Array:
        """What loads that change add to outputs, (0, N): of a plant that settles nothing."""
        return np.empty((0, N))

    def regressors(self, u: Array, Ts: float) -> Array:
        """Filtered inputs, (E, order, N)."""
        out = np.zeros((len(u), self.order, u.shape[1]))
        for row, signals in zip(self.driven(u, Ts), out, strict=True):
            filtered(row, self._discrete_pole(Ts), signals)
        return out

    def averages(self, u: Array, Ts: float, size: int) -> Array:
        """Filtered inputs, averaged over `size` samples each, (E, order, N // size)."""
        if len(u) < _FEW:
            return averaged(self.regressors(u, Ts), size)
        run, a, rows = averages_of(self.order), self._discrete_pole(Ts), 2 * self.order + 2
        driven, found = self.driven(u, Ts), np.empty((len(u), self.order, u.shape[1] // size))

        def one_block(i: int, j: int) -> None:
            averages = np.empty((*found.shape[1:], LANES))
            run(driven, _lanes(i, j), a, size, np.zeros(rows * LANES), averages)
            found[i:j] = averages.transpose(2, 0, 1)[: j - i]

        over_blocks(one_block, len(u), LANES)
        return found

    def driven(self, u: Array, Ts: float) -> Array:
        """What the functions filter: inputs (E, N) themselves."""
        return np.ascontiguousarray(u)

    def _shared(self, u: Array, Ts: float) -> tuple[Array, Array]:
        """Regressors (order, N) of one input (1, N) and their Gram matrix (order, order)."""
        if u.ndim == 3:
            phi = self.regressors(u[0], Ts).reshape(-1, u.shape[2])
            return phi, products(phi, phi)
        kept = _kept if self.order * u.shape[1] <= _LARGEST_KEPT else _of_input
        return kept(self, u.tobytes(), Ts)

    def _own_inputs(
        self, u: Array, y: Array, Ts: float, extra: Array, inner: Array
    ) -> tuple[Array, Array]:
        """`normal_equations` of episodes with an input each."""
        n, a = self.order, self._discrete_pole(Ts)
        run, rows = sums_of(n, len(extra)), 3 * n + 4 + len(extra) * (n + 1)
        u = self.driven(u, Ts)
        sums = np.empty((len(y), rows))

        def one_block(i: int, j: int) -> None:
            work = np.zeros(rows * LANES)
            run(u, y, _lanes(i, j), extra, a, work)
            sums[i:j] = work.reshape(rows, LANES).T[: j - i]

        over_blocks(one_block, len(y), LANES)
        last, first, right = sums[:, :n], sums[:, n + 4 : 2 * n + 4], sums[:, 2 * n + 4 : 3 * n + 4]
        cross = sums[:, 3 * n + 4 :].reshape(len(y), len(extra), n + 1)

        gram = np.empty((len(y), n + len(extra), n + len(extra)))
        gram[:, 0, :n] = gram[:, :n, 0] = first
        s = (a * last[:, 1:] + last[:, :-1]) / np.sqrt(1 - a * a)
        for i in range(1, n):
            row = gram[:, i - 1, i - 1 : n - 1] - s[:, i - 1, None] * s[:, i - 1 :]
            gram[:, i, i:n] = gram[:, i:n, i] = row
        gram[:, n:, :n] = cross[:, :, :n]
        gram[:, :n, n:] = cross[:, :, :n].transpose(0, 2, 1)
        gram[:, n:, n:] = inner
        return gram, np.concatenate([right, cross[:, :, n]], axis=1)

    def _discrete_pole(self, Ts: float) -> float:
        return float(np.exp(-self.pole * Ts))


def _lanes(start: int, stop: int) -> NDArray[np.int64]:
    """Episodes of a block, the last of them repeated in lanes that are left."""
    return np.minimum(np.arange(start, start + LANES), stop - 1)


def _of_input(functions: Laguerre, u: bytes, Ts: float) -> tuple[Array, Array]:
    """Regressors (order, N) of one input and their Gram matrix (order, order)."""
    phi = functions.regressors(np.frombuffer(bytearray(u))[None], Ts)[0]
    return phi, products(phi, phi)


_kept = lru_cache(maxsize=4)(_of_input)


def _right_sides(phi: Array, y: Array) -> Array:
    """Products of outputs (B, N) with regressors (n, N) that they share, (B, n)."""
    values = np.empty((len(y), len(phi)))

    def some(i: int, j: int) -> None:
        values[i:j] = products(phi, y[i:j]).T

    over_blocks(some, len(y), _EPISODES)
    return values


def excites(u: Array) -> NDArray[np.bool_]:
    """Which inputs (B, N) excite a recorded output; the last sample comes too late.

    Of several inputs (B, m, N) all must.
    """
    moving = np.asarray(u[..., :-1].any(axis=-1))
    return moving if u.ndim == 2 else np.asarray(moving.all(axis=1))


def lifted(gram: Array) -> Array:
    """Gram matrices (..., n, n), kept regular for an input of zeros.

    Orthonormal functions and a broad-band input keep the normal equations well
    conditioned; they are several times faster than a decomposition of the regressors.
    """
    trace = np.trace(gram, axis1=-2, axis2=-1)[..., None, None]
    return np.asarray(gram + np.where(trace > 0, 1e-14 * trace, 1.0) * np.eye(gram.shape[-1]))


def averaged(signals: Array, size: int) -> Array:
    """Means (..., N // size) of as many samples each."""
    N = signals.shape[-1] // size
    blocks = signals[..., : N * size].reshape(*signals.shape[:-1], N, size)
    return np.asarray(np.einsum("...ns->...n", blocks) / size)  # a fifth of the time of a mean


def products(a: Array, b: Array) -> Array:
    """``a @ b.T`` of long rows, in parts so small that BLAS does not share them out.

    Its threads wait for each other: on a busy machine that took 300 times as long as the
    work.  `over_blocks` shares out whole episodes instead.
    """
    step = _columns(len(a), len(b))
    out = np.zeros((len(a), len(b)))
    for k in range(0, a.shape[1], step):
        out += a[:, k : k + step] @ b[:, k : k + step].T
    return out


def combined(weights: Array, signals: Array) -> Array:
    """``weights @ signals`` of long rows (n, N), in parts as small as those of `products`."""
    step = _columns(*weights.shape)
    out = np.empty((len(weights), signals.shape[1]))
    for k in range(0, signals.shape[1], step):
        np.matmul(weights, signals[:, k : k + step], out=out[:, k : k + step])
    return out


def _columns(rows: int, columns: int) -> int:
    """How many columns at a time; a single row is shared out sooner than a matrix."""
    serial = _SERIAL_ROW if min(rows, columns) == 1 else _SERIAL
    return max(serial // max(rows * columns, 1), 1)
