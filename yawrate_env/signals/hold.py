"""Held inputs that act on a plant as inputs do which are joined by lines.

A simulator holds its input from sample to sample; the input of an analogue generator, or one
that was measured, is nearer to lines between its samples.  Held for ``Ts``, a sequence v with
``x = omega Ts/2`` has the spectrum ``v e^{-jx} sin(x)/x``, and joined by lines a sequence u has
``u (sin(x)/x)^2`` (Franklin, Powell and Workman, *Digital Control of Dynamic Systems*, 3rd ed.,
section 5.3), so that both act alike where

    v = u e^{jx} sin(x)/x,

the mean of a smooth curve through u over the sample that follows.  Of the images above half the
sampling rate nothing is said; they are what a plant suppresses.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HOLDS = ("held", "lines")
"""How an input runs between its samples."""


def held_like_lines(u: Array, Ts: float, at: Array, hold: float) -> Array:
    """Inputs (B, M), held for `hold` [s] from times `at` (M,), that act as lines through `u` do.

    Parameters
    ----------
    u : (B, N) float64
        Inputs sampled every `Ts` [s] from time 0, four samples or more.
    """
    from scipy.interpolate import make_interp_spline

    N = u.shape[1]
    times, end = Ts * np.arange(N), Ts * (N - 1)
    if hold < Ts:  # the lines themselves have more samples than their ends
        fine = np.append(at[at < end], end)
        u, times = np.stack([np.interp(fine, times, row) for row in u]), fine
    area = make_interp_spline(times, u, k=3, axis=1).antiderivative()
    after = np.minimum(at + hold, end)
    length = after - np.minimum(at, end)
    whole = length > hold / 2  # else there is too little of the line left to have a mean
    means = (area(after) - area(np.minimum(at, end))) / np.where(whole, length, 1.0)
    return np.where(whole, means, u[:, -1:])
