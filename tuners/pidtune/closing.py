"""A closed loop: all its crossovers, its phase margin, and its stability."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.pidtune.system import System

Array = NDArray[np.float64]

_DECADES = 3  # searched beyond the first and the last corner
_A_DECADE = 100
_POINTS = 500_000  # of a Nyquist count, at most
TURNS = 1e4


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """A plant and a controller in series, under negative feedback."""

    plant: System
    controller: Any

    def __call__(self, omega: Array) -> NDArray[np.complex128]:
        """Frequency response [rad/s]."""
        omega = np.asarray(omega, dtype=float)
        at = np.exp(1j * omega * self.plant.Ts) if self.plant.Ts else 1j * omega
        return np.asarray(self.plant(omega) * self.controller(at, warn_infinite=False))

    def crossings(self, near: float) -> Array:
        """Where the magnitude passes 1 [rad/s], ascending.

        Searched for on a logarithmic grid that contains every corner frequency, hence every
        resonance, and refined between its points.
        """
        grid = np.log(self._grid(near))
        passed = np.flatnonzero(np.diff(self._level(grid) >= 0.0))
        return np.exp([self._crossing(grid[i], grid[i + 1]) for i in passed])

    def _crossing(self, low: float, high: float) -> float:
        from scipy.optimize import brentq

        def level(x: float) -> float:
            return float(self._level(np.asarray(x)))

        # An end within rounding of magnitude 1 can change sides when it is evaluated alone.
        if level(low) * level(high) > 0:
            return low if abs(level(low)) < abs(level(high)) else high
        return float(brentq(level, low, high, xtol=1e-15))

    def _level(self, x: Array) -> Array:
        """Logarithm of the magnitude at exp(x); high on a pole."""
        with np.errstate(divide="ignore"):
            found = np.log(np.abs(self(np.exp(x))))
        return np.clip(np.where(np.isnan(found), 700.0, found), -700.0, 700.0)

    def falls_for_good(self, near: float) -> bool:
        """Whether the magnitude ends below 1."""
        return bool(np.abs(self(self._grid(near)[-1])) < 1.0)

    def phase_margin(self, omega: float) -> float:
        """Between -180 and 180 [deg]."""
        return float(np.degrees(np.angle(-self(np.asarray(omega)))))

    def stable(self, near: float) -> bool:
        """By the closed loop's poles; by a Nyquist count where a delay leaves infinitely many.

        ``ValueError`` where the delay turns the loop more than `TURNS` times before its
        magnitude is small, which is not counted.
        """
        num, den = self.plant.polynomials()
        num = np.polymul(num, self.controller.num[0][0])
        den = np.polymul(den, self.controller.den[0][0])
        if self.plant.delay and not self.plant.Ts:
            return self._unstable_poles(num, den, near) == 0
        closed = np.polyadd(num, den)
        if abs(closed[0]) <= 1e-12 * np.abs(closed).max() * (len(num) == len(den)):
            return False  # an algebraic loop
        roots = np.roots(closed)
        if self.plant.Ts:
            return bool((np.abs(roots) < 1.0).all())
        return bool((roots.real < 0.0).all())

    def _unstable_poles(self, num: Array, den: Array, near: float) -> int:
        """Turns that ``den + num exp(-s delay)`` falls short of along the imaginary axis.

        A stable one of degree n turns by n quarter turns (Mikhailov); every root in the
        right half plane takes half a turn from it.
        """
        delay = self.plant.delay
        grid = self._grid(near)
        if np.abs(self(grid[-1])) >= 1.0:
            return 1  # at the least: the loop is large at frequencies without end

        def turn(omega: Array) -> Array:
            s = 1j * omega
            closed = np.polyval(den, s) + np.polyval(num, s) * np.exp(-s * delay)
            return np.asarray(np.angle(closed))

        large = grid[np.abs(self(grid)) > 0.1].max(initial=0.0)
        turns = large * delay / (2 * np.pi)
        if turns > TURNS:
            raise ValueError(
                f"delay = {delay:g} s turns the loop {turns:.3g} times before it is small; "
                f"stability is decided up to {TURNS:g} turns. Lower wc or the delay."
            )
        grid = np.concatenate([[0.0], grid, np.arange(0.0, large, np.pi / (8 * delay))])
        grid = np.unique(grid)
        for _ in range(60):
            step = np.diff(np.unwrap(turn(grid)))
            coarse = np.flatnonzero(np.abs(step) > np.pi / 8)
            if not len(coarse) or len(grid) > _POINTS:
                break
            grid = np.sort(np.append(grid, (grid[coarse] + grid[coarse + 1]) / 2))
        turned = step.sum() - np.angle(1 + self(grid[-1]))
        return int(np.round((len(den) - 1) / 2 - turned / np.pi))

    def _grid(self, near: float) -> Array:
        corners = np.append(self.plant.corners, near)
        low, high = corners.min() / 10**_DECADES, corners.max() * 10**_DECADES
        if self.plant.Ts:
            nyquist = np.pi / self.plant.Ts
            corners, high = corners[corners < nyquist], nyquist * (1 - 1e-12)
        count = int(_A_DECADE * np.log10(high / low)) + 2
        shifted = corners * (1 + 1e-9)  # a pole may be on the axis
        return np.unique(np.concatenate([np.geomspace(low, high, count), shifted]))
