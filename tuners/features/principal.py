"""First stage for any input: the response of the nearest model that simulated plants resemble.

Each input leaves other combinations of many Laguerre coefficients in the noise.  Simulated plants
have theirs near a plane of few directions ``W`` about a mean ``m``, so the recording's are sought
there alone, by least squares, ``c = m + W z``.  Noise of any input and strength leaves that
estimate without bias, as `tuners.features.regularised` is not: what a learner makes of it holds
for every input.  Log magnitude and phase of the model at a few frequencies are the features
(`tuners.features.response`).
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre import lifted
from tuners.features.regularised import Regularised, components, rounded
from tuners.features.response import FrequencyResponse

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PrincipalResponse:
    """First stage: log magnitude and phase [rad] of a model with few free directions.

    Attributes
    ----------
    order, pole, low, high, points
        Of the functions and the frequencies, as `FrequencyResponse` has them.
    mean : tuple of float
        The simulated plants' mean coefficients (order,).
    directions : tuple of tuple of float
        (r, order) what one standard deviation along each of their principal components adds.
    """

    order: int
    pole: float
    low: float
    high: float
    points: int
    mean: tuple[float, ...]
    directions: tuple[tuple[float, ...], ...]

    any_experiment: ClassVar[bool] = False
    one_pair: ClassVar[bool] = True

    def __post_init__(self) -> None:
        model = self.model  # checks what is common to both
        object.__setattr__(self, "mean", model.mean)
        object.__setattr__(self, "directions", model.directions)

    @property
    def width(self) -> int:
        """Number of features."""
        return self.response.width

    def __call__(self, u: Array, y: Array, Ts: float) -> tuple[Array, NDArray[np.bool_]]:
        """Features (B, 2 points) of episodes sampled at `Ts` [s], and which are usable (B,)."""
        z, usable = self.model(u, y, Ts)
        features = self.response.of(np.array(self.mean) + z @ np.array(self.directions), Ts)
        return features, np.asarray(usable & np.isfinite(features).all(axis=1))

    @property
    def model(self) -> Regularised:
        """Least squares along the directions, without regularisation."""
        return Regularised(self.order, self.pole, self.mean, self.directions, variance=0.0)

    @property
    def response(self) -> FrequencyResponse:
        """What is read from the model."""
        return FrequencyResponse(self.order, self.pole, self.low, self.high, self.points)


def principal(
    response: FrequencyResponse, count: int, gram: Array, right: Array
) -> PrincipalResponse:
    """The first stage that knows the directions of simulated plants' coefficients.

    Parameters
    ----------
    response : FrequencyResponse
        Functions and frequencies.
    count : int
        Directions.  Too few leave out what shows in the noise, and each adds its variance.
    gram, right : (B, order, order), (B, order) float64
        Normal equations of noise-free recordings.
    """
    coefficients = np.asarray(np.linalg.solve(lifted(gram), right[..., None])[..., 0], np.float64)
    found = components(coefficients)
    if len(found) < count:
        raise ValueError(
            f"components = {count}: the simulated plants' Laguerre coefficients differ in "
            f"{len(found)} directions only. Ask for fewer."
        )
    return PrincipalResponse(
        response.order, response.pole, response.low, response.high, response.points,
        rounded(coefficients.mean(axis=0)), tuple(map(rounded, found[:count])),
    )  # fmt: skip
