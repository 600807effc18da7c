"""The response that several recordings of one plant show at the crossover.

Each recording asks for a controller's log magnitude and phase, x_i with covariance C_i.  Where the
recordings were taken at one operating point these are pooled by their covariances,

    C = (sum_i C_i^-1)^-1,   x = C sum_i C_i^-1 x_i.

Elsewhere what is pooled is by how much each differs from the fitted plant at its own operating
point, and the fitted plant at the wanted one is corrected by that: what the plant's data get wrong
is taken to be the same everywhere.  Where recordings differ by more than chance, C grows by their
chi-square over its mean (Birge, 1932).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tuners.trust.response import Response

Array = NDArray[np.float64]

_CHANCE = 0.01  # of right recordings whose covariance grows


@dataclass(frozen=True, slots=True, eq=False)
class Coordinates:
    """What L recordings of each of B sets ask of the controller at the crossover.

    Attributes
    ----------
    offsets : NDArray
        (L, B, 2) log magnitude and phase [rad] beyond those of the reference.
    reference : NDArray
        (B, 2) the reference at the wanted operating point.
    precision : NDArray
        (L, B, 2, 2) inverse covariances; zero where a recording shows nothing.
    """

    offsets: Array
    reference: Array
    precision: Array

    @classmethod
    def of(
        cls, responses: Sequence[Response], references: Array, reference: Array
    ) -> "Coordinates":
        """From recordings' responses, the plant's at their operating points (L, B, 2), and here."""
        with np.errstate(invalid="ignore"):
            offsets = np.stack([each.required for each in responses]) - references
        covariance = np.stack([each.covariance for each in responses])
        shown = np.asarray(np.isfinite(offsets).all(axis=2))
        shown &= np.isfinite(covariance).all(axis=(2, 3))
        safe = np.where(shown[..., None, None], covariance, np.eye(2))
        precision = np.linalg.pinv(safe, hermitian=True) * shown[..., None, None]
        return cls(np.where(shown[..., None], offsets, 0.0), reference, precision)

    @property
    def shares(self) -> Array:
        """(L, B) of the information."""
        covariance, _ = mean(self.offsets, self.precision)
        return np.asarray(np.einsum("bij,lbji->lb", covariance, self.precision) / 2)


def mean(offsets: Array, precision: Array) -> tuple[Array, Array]:
    """Covariance (B, 2, 2) and weighted mean (B, 2) of offsets (L, B, 2)."""
    total = precision.sum(axis=0)
    covariance = np.linalg.pinv(total, hermitian=True)
    return covariance, (covariance @ (precision @ offsets[..., None]).sum(axis=0))[..., 0]


def pooled(responses: Sequence[Response], found: Coordinates) -> Response:
    """One response for each set; its output and residual are all recordings' in a row."""
    from scipy.stats import chi2

    covariance, offset = mean(found.offsets, found.precision)
    required = found.reference + offset
    left = found.offsets - offset
    distance = np.einsum("lbi,lbij,lbj->b", left, found.precision, left)
    freedom = 2 * (len(responses) - 1)
    if freedom:
        scattered = np.asarray(distance > chi2.isf(_CHANCE, freedom))
        covariance = covariance * np.where(scattered, distance / freedom, 1.0)[:, None, None]
    nothing = np.asarray(~np.isfinite(required).all(axis=1))
    nothing |= ~found.precision.any(axis=(0, 2, 3))
    required = np.where(nothing[:, None], np.nan, required)
    first, zeros = responses[0], np.zeros(len(required))
    output = np.concatenate([each.output for each in responses], axis=1)
    lengths = np.array([each.output.shape[1] for each in responses])
    noise = np.stack([each.noise for each in responses], axis=1) @ (lengths / lengths.sum())
    return replace(
        first,
        values=_values(responses, found.shares, required),
        required=required,
        covariance=np.where(nothing[:, None, None], np.nan, covariance),
        output=output,
        noise=noise,
        colour=np.max([each.colour for each in responses], axis=0),
        halves=np.zeros_like(first.halves),
        changed=zeros,
        lingering=zeros,
        curvature=first.curvature.none,
        coefficients=np.full_like(first.coefficients, np.nan),
    )


def carried(response: Response, found: Coordinates, i: int) -> Response:
    """The response of recording `i` as it would be at the wanted operating point."""
    with np.errstate(invalid="ignore"):
        change = found.reference + found.offsets[i] - response.required
    return shifted(response, change)


def shifted(response: Response, change: Array) -> Response:
    """The plant that asks for another log magnitude and phase: `change` (B, 2) more of each."""
    with np.errstate(invalid="ignore", over="ignore"):
        factor = np.exp(-change[:, 0] - 1j * change[:, 1])[:, None]
        values, required = response.values * factor, response.required + change
    return replace(response, values=values, required=required)


def _values(
    responses: Sequence[Response], weights: Array, required: Array
) -> NDArray[np.complex128]:
    """Weighted geometric means (B, F) of responses, brought to what is required."""
    first = responses[0].values
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = [np.nan_to_num(np.log(each.values / first)) for each in responses]
        asked = [np.nan_to_num(each.required) for each in responses]
        between = sum(w[:, None] * r for w, r in zip(weights, ratios, strict=True))
        # The first one's own branch of the logarithm cancels between `asked` and `ratios`.
        own = sum(w[:, None] * r for w, r in zip(weights, asked, strict=True))
        change = required - own
        values = first * np.exp(between - change[:, :1] - 1j * change[:, 1:])
    return np.asarray(values)
