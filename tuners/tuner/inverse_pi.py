"""Nonlinear least squares on the inverse of a Tustin PI.

With ``r = Ts/(2 Ti)`` and q a sample's delay,

    C^-1 = (1/kp) (1 - q) / ((1 + r) - (1 - r) q).

``1/kp`` is linear and has a closed form for every r (variable projection, Golub and Pereyra,
1973).  What is left, a function of ``log r`` alone, is searched on a grid over all phases that a PI
has at the crossover, and then by Gauss and Newton's method with Kaufman's gradient; a step that
makes it worse is halved.
"""

import numpy as np
from numpy.typing import NDArray

from yawrate_env.compiled import kernel
from yawrate_env.loop.target import Target

Array = NDArray[np.float64]

_TANGENTS = 1e-3, 1e2  # of the lag at the crossover: from 0.06 to 89.4 degrees
_GRID, _STEPS = 16, 60
_SETTLED = 1e-11  # of log r
_ROUNDED = 1e-13  # of the output's energy


def controller(target: Target, u: Array, y: Array, step: int) -> NDArray[np.complex128]:
    """Response (B,) at the crossover of the PIs with the best ``y = C^-1 u``.

    Parameters
    ----------
    u, y : (1 or B, N) and (B, N)
        Samples `step` apart are one sample of the controller apart.

    Returns
    -------
    (B,) complex
        Without lag where less lag would always be better, with 90 degrees where more would;
        ``nan`` where the search does not converge.
    """
    tangent = np.tan(target.omega_c * target.Ts / 2)
    low, high = (float(np.log(t * tangent)) for t in _TANGENTS)
    found = np.empty((len(y), 2))
    _search(u, y, step, low, high, found)
    inverse, log_r = found.T
    response = 1 - 1j * np.exp(log_r) / tangent
    response = np.where(log_r <= low, 1.0, np.where(log_r >= high, -1j * abs(response), response))
    return np.asarray(response / inverse)


@kernel
def _sums(
    u: NDArray[np.float64],
    y: NDArray[np.float64],
    step: int,
    r: float,
    h: NDArray[np.float64],
    s: NDArray[np.float64],
) -> tuple[float, float, float, float, float]:
    """Products hh, hy, hs, ss, sy of the filtered input h (N,) and its slope s to log r."""
    before, gain = (1 - r) / (1 + r), 1 / (1 + r)
    hh = hy = hs = ss = sy = 0.0
    for t in range(len(y)):
        last = t - step
        if last >= 0:
            h[t] = before * h[last] + gain * (u[t] - u[last])
            s[t] = before * s[last] - gain * r * (h[t] + h[last])
        else:
            h[t] = gain * u[t]
            s[t] = -gain * r * h[t]
        hh += h[t] * h[t]
        hy += h[t] * y[t]
        hs += h[t] * s[t]
        ss += s[t] * s[t]
        sy += s[t] * y[t]
    return hh, hy, hs, ss, sy


@kernel
def _search(
    u: NDArray[np.float64],
    y: NDArray[np.float64],
    step: int,
    low: float,
    high: float,
    found: NDArray[np.float64],
) -> None:
    """Fill (B, 2) with 1/kp and log r; not a number where there is no answer."""
    h, s = np.empty(y.shape[1]), np.empty(y.shape[1])
    for b in range(len(y)):
        input, output = u[min(b, len(u) - 1)], y[b]
        energy = 0.0
        for t in range(len(output)):
            energy += output[t] * output[t]
        at, cost = low, np.inf
        for i in range(_GRID):
            tried = low + (high - low) * i / (_GRID - 1)
            hh, hy, hs, ss, sy = _sums(input, output, step, np.exp(tried), h, s)
            left = energy - hy * hy / hh
            if left < cost:
                at, cost = tried, left
        hh, hy, hs, ss, sy = _sums(input, output, step, np.exp(at), h, s)
        converged, fraction = False, 1.0
        for _ in range(_STEPS):
            inverse = hy / hh
            move = (sy - hs * inverse) / (inverse * (ss - hs * hs / hh))
            tried = min(max(at + fraction * move, low), high)
            if abs(tried - at) <= _SETTLED:
                converged = True
                break
            new = _sums(input, output, step, np.exp(tried), h, s)
            left = energy - new[1] * new[1] / new[0]
            if left <= cost + _ROUNDED * energy:
                at, cost, fraction = tried, left, 1.0
                hh, hy, hs, ss, sy = new
            else:
                fraction /= 2
        found[b, 0] = hy / hh if converged else np.nan
        found[b, 1] = at
