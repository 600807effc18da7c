"""The steering actuator with limits, exact between samples.

Eq. (9) in the road wheel's angle and rate, behind a command that is clipped to the
angle limit, is

    delta' = s,   s' = omega_n^2 (command - delta) - 2 xi omega_n s,   |s| <= rate

where ``s' = 0`` as long as the rate is at its limit and would leave it.  With a held
command both regimes have exact solutions, so the only thing to find is when one gives
way to the other.  A step of the vehicle's integration is therefore cut at these
moments: on each of its at most ``PIECES`` pieces the right-hand side is smooth.  Steps
without such a moment, nearly all, cost two small matrix products.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.compiled import kernel

PIECES = 4
PIECE = 4
"""What is known of a piece: its length, and the angle at its start, middle and end."""

_TERMS = 12
_BISECTIONS = 50
_NEVER = 1e-12  # of the rate, or of the step: below, it is rounding


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of the steering actuator, at the road wheel.

    Attributes
    ----------
    angle : float
        Greatest angle [rad].
    rate : float
        Greatest rate [rad/s]; about 60 deg/s is a steering wheel at 900 deg/s.
    """

    angle: float = float(np.radians(35.0))
    rate: float = float(np.radians(60.0))

    def __post_init__(self) -> None:
        validation.number("limits angle", self.angle, at_least=1e-3, at_most=np.pi / 3,
                          remedy="Give it in rad.")  # fmt: skip
        validation.number("limits rate", self.rate, at_least=1e-3, at_most=1e3,
                          remedy="Give it in rad/s.")  # fmt: skip


@kernel
def cut(
    angle: float,
    rate: float,
    command: float,
    h: float,
    omega: float,
    xi: float,
    limit: float,
    pieces: NDArray[np.float64],
) -> float:
    """Follow the actuator for `h` seconds, piece by piece; return its rate at the end.

    `pieces` (PIECES, PIECE) is filled; unused ones have no length.
    """
    series = np.empty(_TERMS)
    left = h
    for piece in range(PIECES):
        if left <= 0.0:
            pieces[piece, 0] = 0.0
            pieces[piece, 1:] = angle
            continue
        last = piece == PIECES - 1
        pull = omega * (omega * (command - angle) - 2.0 * xi * rate)
        span = left
        release = 0.0
        if abs(rate) >= limit and pull * rate > 0.0:
            release = (command - angle) / rate - 2.0 * xi / omega
        pieces[piece, 1] = angle
        if release > _NEVER * h:
            if not last:
                span = min(left, release)
            pieces[piece, 2] = angle + 0.5 * span * rate
            angle += span * rate
        else:
            _taylor(angle - command, rate, omega, xi, series)
            side = 1.0 if pull > 0.0 else -1.0
            hit = False
            if not last:
                span, hit = _until(series, side, limit, left)
            pieces[piece, 2] = command + _value(series, 0.5 * span)
            angle = command + _value(series, span)
            rate = side * limit if hit else _slope(series, span)
        pieces[piece, 0] = span
        pieces[piece, 3] = angle
        left -= span
    return rate


@kernel
def _taylor(e: float, s: float, omega: float, xi: float, series: NDArray[np.float64]) -> None:
    """Coefficients of e(t) from ``e'' = -2 xi omega e' - omega^2 e``."""
    series[0], series[1] = e, s
    for k in range(_TERMS - 2):
        series[k + 2] = (
            -(2.0 * xi * omega * (k + 1) * series[k + 1] + omega * omega * series[k])
            / ((k + 1) * (k + 2))
        )  # fmt: skip


@kernel
def _value(series: NDArray[np.float64], t: float) -> float:
    total = 0.0
    for k in range(_TERMS - 1, -1, -1):
        total = total * t + series[k]
    return total


@kernel
def _slope(series: NDArray[np.float64], t: float) -> float:
    total = 0.0
    for k in range(_TERMS - 1, 0, -1):
        total = total * t + k * series[k]
    return total


@kernel
def _bend(series: NDArray[np.float64], t: float) -> float:
    total = 0.0
    for k in range(_TERMS - 1, 1, -1):
        total = total * t + k * (k - 1) * series[k]
    return total


@kernel
def _until(
    series: NDArray[np.float64], side: float, limit: float, left: float
) -> tuple[float, bool]:
    """When the rate, moving towards `side`, turns or hits its limit, and whether it hits."""
    end = left
    if side * _bend(series, left) < 0.0:
        low, high = 0.0, left
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            if side * _bend(series, middle) > 0.0:
                low = middle
            else:
                high = middle
        end = high
    if side * _slope(series, end) <= limit * (1.0 + _NEVER):
        return end, False
    low, high = 0.0, end
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if side * _slope(series, middle) < limit:
            low = middle
        else:
            high = middle
    return high, True
