"""Test whether what a recording's start explains ends when the plant has forgotten it.

The free response of a plant that was driven before the recording is, with impulse response g,

    y(t) = sum of g(t + s) u(-s) over s > 0,   |y(t)| <= max |u| sum of |g(s)| over s > t,

so it is over when the impulse response is.  A plant that changes, or is not linear, has residuals
that the decays of many functions explain as well, for as long as they last.
"""

import numpy as np
from numpy.typing import NDArray

from tuners.trust.black_box import BlackBox, decays

Array = NDArray[np.float64]

_ROUNDED = 1e-12  # of the output
_STRONGER = 2.0  # than in the recording: what the input may have been before it


def lingering(model: BlackBox, coefficients: Array) -> Array:
    """Free responses that last longer than they can, over the output, root mean squares (B,).

    Parameters
    ----------
    coefficients : (B, n) float64
        Of the impulse responses.
    """
    found, moving = np.zeros(len(model.y)), np.flatnonzero(model.extra > 2)
    if not len(moving):
        return found
    N = model.y.shape[1]
    functions, line = decays(model.functions, N, model.Ts), np.linspace(-1.0, 1.0, N)
    for i in moving.tolist():
        left = np.abs(coefficients[i] @ functions)[::-1].cumsum()[::-1]
        most = _STRONGER * np.abs(model.u[i % len(model.u)]).max() * left
        start = model.free[i] - model.offset[i] - model.trend[i] * line
        size = np.sqrt((model.y[i] ** 2).mean())
        beyond = np.maximum(np.abs(start) - most - _ROUNDED * size, 0.0)
        found[i] = np.sqrt((beyond**2).mean()) / size if size > 0 else 0.0
    return found
