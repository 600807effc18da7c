"""Exact slopes of a plant's output, for plants that compute them faster than by differences."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Sensitivity(Protocol):
    """Normal equations of the search for a plant's unknown parameters.

    The search runs in coordinates z (B, q) of the plant's own, such as logarithms.
    """

    def encode(self, theta: Array) -> Array:
        """Parameters (B, p) to coordinates (B, q) of the unknown ones."""

    def decode(self, z: Array, theta: Array) -> Array:
        """Parameters (B, p): the coordinates' values in place of those in `theta`."""

    def shortened(self, step: Array) -> Array:
        """Steps (B, q) of the coordinates, no longer than one step of the search should be."""

    def gram(self, theta: Array, u: Array, y: Array, rows: NDArray[np.intp]) -> Array:
        """Inner products (R, 1 + q, 1 + q) over recordings from rest.

        The first signal is the output error ``y - respond(theta, u)``, the others are the
        derivatives of the output to z.

        Parameters
        ----------
        theta : (R, p) float64
            A model for each of R recordings.
        u : (1, N) or (B, N) float64
        y : (B, N) float64
            Inputs and outputs of all B recordings.
        rows : (R,) int
            Which of them the models belong to.
        """
