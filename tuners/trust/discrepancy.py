"""How far off a fitted plant may be whose residual is more than white noise.

A covariance for white noise is too small for a residual that is coloured, and says nothing of a
simulator that is wrong.  So the covariance is a sandwich with the residual's own spectrum, and the
fit is repeated, by one Gauss-Newton step, on parts of the recording: its halves in time, its low
and high outputs, and without what a constant and a trend explain, or a curve in the actuator
(`tuners.trust.actuator_curve`).
Where a simulator is right, all of them find the same plant but for noise (Hausman, "Specification
tests in econometrics", 1978); where it is not, the difference that they make to a metric shows how
much its error may matter.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.trust.fast_length import fast_length
from tuners.trust.identification import UNIFORM
from tuners.trust.octaves import octaves

Array = NDArray[np.float64]

_CHANCE = 3.0  # standard deviations of a difference between fits that noise may cause
_FARTHEST = 1.0  # of a range: a longer step is far from linear


@dataclass(frozen=True, slots=True, eq=False)
class Discrepancy:
    """Of B fitted plants, all in widths of the q unknown parameters' ranges.

    Attributes
    ----------
    covariance : NDArray
        (B, q, q) for the residual's own spectrum.
    shifts : NDArray
        (B, m, q) by which parts of a recording ask for other parameters, in m divisions.
    chance : NDArray
        (B, m, q, q) covariances of `shifts` that are chance.
    """

    covariance: Array
    shifts: Array
    chance: Array

    @classmethod
    def of(
        cls,
        error: Array,
        slopes: Array,
        simulated: Array,
        noise: Array,
        inverse: Array,
        white: Array,
        oversampled: float = 1.0,
        outputs: int = 1,
        curves: Array | None = None,
    ) -> "Discrepancy":
        """Of fits' output errors (B, N), slopes (B, q, N) and simulated outputs (B, N).

        Parameters
        ----------
        noise : (B,) float64
            Power of the noise, more than its mean square where samples were interpolated.
        inverse, white : (B, q, q) float64
            Inverse normal matrices, and covariances for white noise of this power.
        oversampled : float
            Samples for each independent one.
        outputs : int
            How many there are, stacked.
        curves : (B, e, N) float64, optional
            What curves in the actuator would add to the outputs.
        """
        quiet = np.minimum(unpatterned(error, oversampled), noise)[:, None, None]
        ridge = noise[:, None, None] / UNIFORM * np.eye(slopes.shape[1])

        def fitted(part: Callable[[Array], Array]) -> tuple[Array, Array]:
            seen = part(slopes)
            own = _solved(slopes @ seen.swapaxes(1, 2) + ridge)
            step = np.clip((own @ (seen @ error[..., None]))[..., 0], -_FARTHEST, _FARTHEST)
            return step, quiet * own @ (seen @ seen.swapaxes(1, 2)) @ own

        shifts, chance = [], []
        for mask in _divisions(simulated, outputs):
            (one, by_one), (other, by_other) = fitted(_of(mask)), fitted(_of(~mask))
            shifts.append((one - other) / 2)  # how far either is from the whole
            chance.append((by_one + by_other) / 4)
        seen = _without_line(slopes, outputs)
        own = slopes @ seen.swapaxes(1, 2)
        shifts.append(2 * (inverse @ (seen @ error[..., None]))[..., 0])
        chance.append(4 * quiet * inverse @ (own - own @ inverse @ own) @ inverse)
        if curves is not None:  # what else is wrong with a recording may look like one
            part = _without(curves)
            seen, (apart, by) = part(slopes), fitted(part)
            own = _solved(slopes @ seen.swapaxes(1, 2) + ridge)
            left = part(error[:, None])[:, 0] - (apart[:, None] @ seen)[:, 0]
            shifts.append(apart)
            chance.append(by + own @ _coloured(left, seen, noise, outputs) @ own)
        more = inverse @ _coloured(error, slopes, noise, outputs) @ inverse
        return cls(white + more, np.stack(shifts, axis=1), np.stack(chance, axis=1))

    def spread(self, J: Array) -> Array:
        """Standard deviations (B, f) of metrics with slopes J (B, f, q), in coloured noise."""
        return np.asarray(np.sqrt(np.einsum("bfi,bij,bfj->bf", J, self.covariance, J)))

    def difference(self, J: Array) -> Array:
        """The most by which parts of the recording move metrics, beyond chance, (B, f)."""
        moved = np.abs(np.einsum("bfi,bmi->bmf", J, self.shifts))
        variance = np.einsum("bfi,bmij,bfj->bmf", J, self.chance, J)
        beyond = moved - _CHANCE * np.sqrt(np.maximum(variance, 0.0))
        return np.asarray(np.maximum(beyond, 0.0).max(axis=1))


def _divisions(simulated: Array, outputs: int) -> tuple[NDArray[np.bool_], ...]:
    """Late and high samples of outputs (B, N), each half of a recording; (1 or B, 1, N)."""
    each = simulated.shape[1] // outputs
    late = np.tile(np.arange(each) >= each // 2, outputs)
    apart = simulated.reshape(len(simulated), outputs, each)
    high = (apart > np.median(apart, axis=2, keepdims=True)).reshape(simulated.shape)
    return late[None, None], high[:, None]


def _of(mask: NDArray[np.bool_]) -> Callable[[Array], Array]:
    return lambda signals: signals * mask


def _without(curves: Array) -> Callable[[Array], Array]:
    """Signals (B, m, N) without what signals (B, e, N) explain."""
    Q, _ = np.linalg.qr(curves.swapaxes(1, 2))
    return lambda signals: np.asarray(signals - (signals @ Q) @ Q.swapaxes(1, 2))


def unpatterned(error: Array, oversampled: float) -> Array:
    """Power (B,) of the part of residuals (B, N) that changes between independent samples."""
    apart = int(np.ceil(oversampled))
    changes = error[:, apart:] - error[:, :-apart]
    return np.asarray((changes**2).mean(axis=1) / 2 * oversampled)


def _without_line(signals: Array, outputs: int) -> Array:
    """Signals (B, m, N) without what a constant and a trend of each output explain."""
    N = signals.shape[2] // outputs
    Z, _ = np.linalg.qr(np.stack([np.ones(N), np.linspace(-1.0, 1.0, N)], axis=1))
    parts = np.split(signals, outputs, axis=2)
    return np.concatenate([part - (part @ Z) @ Z.T for part in parts], axis=2)


def _solved(matrix: Array) -> Array:
    """Inverse of B symmetric matrices (B, q, q); none where there is none."""
    regular = np.asarray(np.isfinite(matrix).all(axis=(1, 2)))[:, None, None]
    return np.asarray(np.linalg.pinv(np.where(regular, matrix, 0.0), rcond=1e-14, hermitian=True))


def _coloured(error: Array, slopes: Array, noise: Array, outputs: int) -> Array:
    """Covariance (B, q, q) of products of slopes and noise, beyond that of white noise."""
    errors, parts = (np.split(each, outputs, axis=-1) for each in (error, slopes))
    found = [_coloured_output(e, s, noise) for e, s in zip(errors, parts, strict=True)]
    return np.asarray(np.sum(found, axis=0))


def _coloured_output(error: Array, slopes: Array, noise: Array) -> Array:
    (N, q), length = slopes.shape[:0:-1], fast_length(error.shape[1])
    power = np.abs(np.fft.rfft(error, length)) ** 2 / N
    X = np.fft.rfft(slopes, length) * np.sqrt(2 / length)
    X[..., [0, -1]] /= np.sqrt(2)
    more = np.maximum(octaves(power, q, noise) - noise[:, None], 0.0)
    return np.asarray(((X * more[:, None]) @ X.conj().swapaxes(1, 2)).real)
