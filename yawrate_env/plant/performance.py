"""The performance of a loop: what the design rule gives, metrics, targets, errors and reward."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.loop.target import Target
from yawrate_env.plant.calls import call, rows
from yawrate_env.plant.distributions import Spread
from yawrate_env.plant.metric import Metric
from yawrate_env.plant.names import MARGINS, split
from yawrate_env.plant.parametrisation import Parametrisation
from yawrate_env.plant.responses import ClosedLoop
from yawrate_env.plant.reward import defined, reward

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Performance:
    """What follows from the design rule and the metrics: the part of a `Plant` that rates gains."""

    __slots__ = ()

    prior: Mapping[str, Spread]
    gains: tuple[str, ...]
    design: Callable[[Array], Array | tuple[Array, Flags]]
    evaluate: Callable[[Array, Array], Array | tuple[Array, Flags]] | None
    settings: Mapping[str, Metric]
    counted: tuple[str, ...]
    target: tuple[float, ...] | None
    parametrisation: Parametrisation
    linear: bool
    batched: bool
    loop: Callable[[Array, Array], ClosedLoop] | None
    _counted: list[int]

    def oracle(self, theta: Array) -> Array:
        """Gains (B, k) of the design rule that knows the parameters."""
        return self.designs(theta)[0]

    def designs(self, theta: Array) -> tuple[Array, Flags]:
        """Gains (B, k) of the design rule, and whether they exist and reach the target (B,).

        Nothing should be learned from gains that only come near it.
        """
        gains, reached = self._rows("design", self.design, len(self.gains), theta)
        found = np.isfinite(gains).all(axis=1)
        return gains, np.asarray(found if reached is None else found & reached)

    def evaluation(self, theta: Array, gains: Array) -> tuple[Array, Flags]:
        """All metrics (B, m) of gains as `evaluate` gives them, and whether loops are stable."""
        if self.evaluate is None:
            with np.errstate(divide="ignore", invalid="ignore"):
                values = np.asarray(gains / self.oracle(theta) - 1)
            return values, np.asarray(~np.isnan(values).any(axis=1))
        usable = np.isfinite(gains).all(axis=1)
        values = np.full((len(theta), len(self.settings)), np.nan)
        stable = np.zeros(len(theta), dtype=np.bool_)
        if usable.any():
            width, given = len(self.settings), (theta[usable], gains[usable])
            found, known = self._rows("evaluate", self.evaluate, width, *given)
            values[usable] = found
            undefined = np.isnan(found[:, self._counted]).any(axis=1)
            stable[usable] = ~undefined if known is None else known
        return values, stable

    def metric_values(self, theta: Array, gains: Array) -> Array:
        """Counted metrics (B, f) of gains.

        ``nan`` where there are no gains or the loop is unstable, ``inf`` where it is stable and
        a metric is undefined.
        """
        return self.counted_values(*self.evaluation(theta, gains))

    def counted_values(self, values: Array, stable: Flags) -> Array:
        """What `metric_values` gives, from an `evaluation`."""
        return defined(values[:, self._counted], stable)

    def targets(self, theta: Array) -> Array:
        """Counted metrics (B, f) that the design rule aims at, or else what it reaches."""
        if self.target is not None:
            return np.tile(np.array(self.target), (len(theta), 1))
        return self.metric_values(theta, self.oracle(theta))

    def closed_loop(self, theta: Array, gains: Array) -> ClosedLoop | None:
        """The loop of gains (k,) around one plant (p,); None where there is nothing to draw."""
        if self.loop is None or not np.isfinite(gains).all():
            return None
        drawn = call("loop", self.loop, theta.copy(), gains.copy())
        remedy = "Give responses, an open loop, or both."
        return validation.instance("loop's answer", drawn, ClosedLoop, remedy=remedy)

    def errors(self, theta: Array, gains: Array) -> Array:
        """Distances of the counted metrics from their targets, (B, f), in their own units."""
        return np.asarray(self.metric_values(theta, gains) - self.targets(theta))

    @property
    def loop_target(self) -> Target | None:
        """Target of the PI loop whose phase margin and crossover count, of a linear plant."""
        counted = tuple(split(name)[0] for name in self.counted)
        return self.parametrisation.target if self.linear and counted == MARGINS else None

    def reward(self, theta: Array, gains: Array) -> Array:
        """Reward (B,) between -5 and 0 (`yawrate_env.plant.reward`)."""
        return self.reward_of(self.errors(theta, gains))

    def reward_of(self, errors: Array) -> Array:
        """Reward (B,) of the metrics' distances from their targets (B, f)."""
        return reward(errors / self.metric_setting("scale"))

    def metric_setting(self, of: str) -> Array:
        """(f,) ``scale``, ``error`` or ``spread`` of the counted metrics."""
        return np.array([getattr(self.settings[name], of) for name in self.counted])

    def _rows(
        self, name: str, function: Callable[..., Any], width: int, *arrays: Array
    ) -> tuple[Array, Flags | None]:
        return rows(name, function, (width,), self.batched, *arrays, names=tuple(self.prior))
