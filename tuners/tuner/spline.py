"""Cubic splines through samples, without an interpolation library's import.

The second derivatives M of the spline through y[0], y[1], ... at unit distance obey

    M[i-1] + 4 M[i] + M[i+1] = 6 (y[i-1] - 2 y[i] + y[i+1]) = d[i]

(de Boor, *A Practical Guide to Splines*, 1978).  With a third derivative that is continuous at the
second and the last but one sample ("not a knot", the usual choice) M is d/6 there and runs straight
outside; between them M is d convolved with ``z^|k| / (2 sqrt 3)``, ``z = sqrt 3 - 2``, and what the
two ends add decays as the powers of z.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_Z = np.sqrt(3.0) - 2.0
_TAPS = _Z ** np.abs(np.arange(-32, 33)) / (2.0 * np.sqrt(3.0))  # the next one is below 1e-18


def spline(y: Array, at: Array) -> Array:
    """Values (B, M) at positions (M,) in samples of splines through (B, N), N of 4 or more."""
    N = y.shape[1]
    M = np.apply_along_axis(_second_derivatives, 1, y)
    i = np.clip(np.floor(at).astype(np.intp), 0, N - 2)
    t = at - i
    s = 1.0 - t
    curved = (s**3 - s) * M[:, i] + (t**3 - t) * M[:, i + 1]
    return np.asarray(s * y[:, i] + t * y[:, i + 1] + curved / 6.0)


def slopes(x: Array, y: Array) -> Array:
    """First derivatives (N,) of the spline through (N,) samples at any places, N of 4 or more.

    They solve de Boor's tridiagonal equations with "not a knot" at both ends.
    """
    h = np.diff(x)
    d = np.diff(y) / h
    before, after = np.append(h[1:], h[-1] + h[-2]), np.append(h[0] + h[1], h[:-1])
    middle = np.concatenate([h[1:2], 2.0 * (h[:-1] + h[1:]), h[-2:-1]])
    right = np.empty(len(x))
    right[1:-1] = 3.0 * (h[1:] * d[:-1] + h[:-1] * d[1:])
    for end, (h0, h1), (d0, d1) in ((0, h[:2], d[:2]), (-1, h[:-3:-1], d[:-3:-1])):
        right[end] = ((h0 + 2.0 * (h0 + h1)) * h1 * d0 + h0**2 * d1) / (h0 + h1)
    return _tridiagonal(before.tolist(), middle.tolist(), after.tolist(), right.tolist())


def _tridiagonal(
    before: list[float], middle: list[float], after: list[float], right: list[float]
) -> Array:
    """Solve by elimination; lists are quicker than arrays here, and a dense matrix is not."""
    for i in range(1, len(middle)):
        share = before[i - 1] / middle[i - 1]
        middle[i] -= share * after[i - 1]
        right[i] -= share * right[i - 1]
    right[-1] /= middle[-1]
    for i in range(len(middle) - 2, -1, -1):
        right[i] = (right[i] - after[i] * right[i + 1]) / middle[i]
    return np.array(right)


def _second_derivatives(y: Array) -> Array:
    """Those (N,) at the samples of one signal (N,)."""
    d = 6.0 * (y[:-2] - 2.0 * y[1:-1] + y[2:])
    between = d.copy()
    between[[0, -1]] = 0.0
    inner = np.convolve(between, _TAPS)[32:-32]
    first, last = d[0] / 6.0 - inner[0], d[-1] / 6.0 - inner[-1]
    far = _Z ** (len(d) - 1)
    first, last = np.array([first - far * last, last - far * first]) / (1.0 - far * far)
    decay = _Z ** np.minimum(np.arange(len(d)), 600)
    M = inner + first * decay + last * decay[::-1]
    return np.concatenate([[2.0 * M[0] - M[1]], M, [2.0 * M[-1] - M[-2]]])
