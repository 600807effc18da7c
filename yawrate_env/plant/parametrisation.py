"""The numbers that learners predict and agents choose instead of the gains themselves."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.loop import controller
from yawrate_env.loop.design import design_from_response
from yawrate_env.loop.target import Target

Array = NDArray[np.float64]
Names = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Parametrisation:
    """Gains (B, k) to coordinates (B, m) whose errors matter alike for every plant, and back.

    Attributes
    ----------
    encode : callable
        Gains (B, k) to coordinates (B, m); ``nan`` where there are none.
    decode : callable
        Coordinates (B, m) to gains (B, k); ``nan`` where there are none.
    names : callable, optional
        Names of the coordinates in data sets, from the gains' names; ``coordinate_1``, ... if
        omitted.
    target : Target, optional
        The loop whose controller the coordinates describe (`loop`).
    columns : tuple of (str, float)
        Kind and scale of each coordinate (`of_gains`); one stands for all, and none for functions
        that exist in Python only.
    """

    encode: Callable[[Array], Array]
    decode: Callable[[Array], Array]
    names: Callable[[Names], Names] | None = None
    target: Target | None = None
    columns: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        validation.function("parametrisation.encode", self.encode)
        validation.function("parametrisation.decode", self.decode)
        validation.function("parametrisation.names", self.names, optional=True)


def scale_to_bounds(actions: NDArray[np.floating], low: Array, high: Array) -> Array:
    """Actions (B, m) in [-1, 1], clipped, to coordinates between `low` and `high` (m,)."""
    unit = (np.clip(np.asarray(actions, dtype=np.float64), -1, 1) + 1) / 2
    return np.asarray(low + (high - low) * unit)


def _log(gains: Array) -> Array:
    return np.log(np.where(gains > 0, gains, np.nan))


def _exp(values: Array) -> Array:
    with np.errstate(over="ignore"):  # far from all that was learned
        return _positive(np.exp(values))


def _positive(gains: Array) -> Array:
    """Gains (B, k); ``nan`` where not all of them are positive and finite."""
    usable = (gains > 0) & np.isfinite(gains)
    return np.where(usable.all(axis=1, keepdims=True), gains, np.nan)


def _log_names(gains: Names) -> Names:
    return tuple(f"log_{name}" for name in gains)


def _same_names(gains: Names) -> Names:
    return gains


LOG = Parametrisation(_log, _exp, _log_names, columns=(("log", 1.0),))
"""Logarithms: relative errors count; for positive gains."""


GAINS = Parametrisation(np.asarray, _positive, _same_names, columns=(("gain", 1.0),))
"""The gains themselves: absolute errors count; for positive gains.

The paper predicts these.  Its Ti runs from 0.07 s to beyond 2 s, so that the squared error is
dominated by the few plants with a long Ti, for which Ti hardly matters.
"""


def of_gains(kinds: Sequence[str], scales: Sequence[float] = ()) -> Parametrisation:
    """Coordinates of each gain by its own kind.

    Parameters
    ----------
    kinds : sequence of {"log", "linear", "signed"}
        The logarithm of gain/scale, which is positive; a gain itself; or ``asinh(gain/scale)``,
        which is linear for gains below the scale and logarithmic beyond, for gains of either sign.
    scales : sequence of float, optional
        1 by default; -1 of logarithms of gains that are all negative.
    """
    for kind in kinds:
        validation.one_of("kind", kind, COLUMNS)
    given = tuple(scales) or (1.0,) * len(kinds)
    if len(given) != len(kinds):
        raise ValueError(f"scales = {scales!r} must be one for each of {len(kinds)} gains.")
    remedy = "A negative one is for logarithms of negative gains."
    for kind, scale in zip(kinds, given, strict=True):
        size = -scale if kind == "log" and scale < 0 else scale
        validation.number("scale", size, above=0.0, remedy=remedy)
    of = _Columns(tuple(zip(kinds, map(float, given), strict=True)))
    return Parametrisation(of.encode, of.decode, of.names, columns=of.columns)


def sign_of(kind: str, scale: float) -> int:
    """Sign of a gain of that kind; 0 where it may have either."""
    return 0 if kind in ("linear", "signed") else int(np.sign(scale))


def signed(*scales: float) -> Parametrisation:
    """Gains of either sign, as of a state feedback: ``asinh(gain/scale)`` each."""
    return of_gains(("signed",) * len(scales), scales)


COLUMNS = "log", "linear", "signed"
_NAMES = {"log": "log_{}", "linear": "{}", "signed": "asinh_{}"}


@dataclass(frozen=True, slots=True)
class _Columns:
    columns: tuple[tuple[str, float], ...]

    def encode(self, gains: Array) -> Array:
        by_kind: dict[str, Any] = {"log": _log, "linear": np.asarray, "signed": np.arcsinh}
        return np.stack(
            [by_kind[kind](gains[:, i] / s) for i, (kind, s) in enumerate(self.columns)], axis=1
        )

    def decode(self, values: Array) -> Array:
        by_kind: dict[str, Any] = {"log": np.exp, "linear": np.asarray, "signed": np.sinh}
        with np.errstate(over="ignore"):  # far from all that was learned
            gains = np.stack(
                [s * by_kind[kind](values[:, i]) for i, (kind, s) in enumerate(self.columns)],
                axis=1,
            )
        signs = np.array([sign_of(*column) for column in self.columns])
        usable = np.isfinite(gains) & ((gains * np.where(signs < 0, -1, 1) > 0) | (signs == 0))
        return np.where(usable.all(axis=1, keepdims=True), gains, np.nan)

    def names(self, gains: Names) -> Names:
        pairs = zip(self.columns, gains, strict=True)
        return tuple(_NAMES[kind].format(name) for (kind, _), name in pairs)


def loop(target: Target) -> Parametrisation:
    """Log magnitude and phase [rad] of a PI controller (kp, Ti) at the target crossover.

    An error of phase is the same error of phase margin for every plant, and the map to
    (kp, Ti) is exact (`yawrate_env.loop.controller`).  A phase that no PI supplies is treated
    as the design rule treats it.
    """
    at = _Loop(target)
    return Parametrisation(at.encode, at.decode, at.names, target)


@dataclass(frozen=True, slots=True)
class _Loop:
    target: Target

    def encode(self, gains: Array) -> Array:
        kp, Ti = np.where(gains > 0, gains, np.nan).T
        return np.stack(controller.response(kp, Ti, self.target), axis=1)

    def decode(self, values: Array) -> Array:
        with np.errstate(over="ignore"):  # far from all that was learned
            found = design_from_response(values[:, 0], values[:, 1], self.target)
        return _positive(np.stack([found.kp, found.Ti], axis=1))

    def names(self, gains: Names) -> Names:
        return "log_gain", "phase"
