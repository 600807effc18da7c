"""The parameters of a family of plants: ranges, indices, and the features of measured ones."""

from collections.abc import Iterable, Mapping
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.plant.distributions import Range, Shape, Spread
from yawrate_env.plant.names import split

Array = NDArray[np.float64]

_MARGIN = 0.5  # of a range's width, by which the search for parameters may leave the prior


class Parameters:
    """What follows from the prior: the part of a `Plant` that calls none of its functions.

    The p parameters are ordered as in the prior; q of them are unknown, to be estimated.
    """

    __slots__ = ()

    prior: Mapping[str, Spread]
    measured: Mapping[str, float]
    initial: tuple[str, ...]
    search_limits: Mapping[str, Range]
    labels: Mapping[str, str]

    @property
    def ranges(self) -> tuple[Array, Array]:
        """Low and high ends of the prior, (p,) each."""
        low, high = np.array([tuple(ends) for ends in self.prior.values()]).T
        return low, high

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """The parameters' priors, (p,)."""
        return tuple(cast("Mapping[str, Shape]", self.prior).values())

    @property
    def width(self) -> Array:
        """Widths of the unknown parameters' ranges, (q,)."""
        low, high = self.ranges
        return np.asarray((high - low)[self.unknown])

    @property
    def middle(self) -> Array:
        """(1, p) parameters in the middle of the prior: of a logarithmic one, the geometric."""
        return np.array([[each.middle for each in self.shapes]])

    @property
    def unknown(self) -> NDArray[np.intp]:
        """(q,) indices of the parameters to estimate: neither measured nor a point."""
        return np.flatnonzero([n not in self.measured and self._open(n) for n in self.prior])

    @property
    def known(self) -> NDArray[np.intp]:
        """(p - q,) indices of all other parameters."""
        return np.setdiff1d(np.arange(len(self.prior)), self.unknown)

    @property
    def measured_names(self) -> tuple[str, ...]:
        """Names of the measured parameters that the prior leaves open."""
        return tuple(name for name in self.prior if name in self.measured and self._open(name))

    @property
    def lasting(self) -> NDArray[np.bool_]:
        """(q,) which unknown parameters are the plant's, and not a recording's initial state."""
        begin = self.indices(self.initial)
        return np.asarray(~np.isin(self.unknown, begin))

    def indices(self, names: Iterable[str]) -> list[int]:
        """Indices of the parameters with these names."""
        return [list(self.prior).index(name) for name in names]

    def measured_features(self, theta: Array) -> Array:
        """Measured parameters (B, m) as features: logarithms of positive ones."""
        columns = [theta[:, i] for i in self.indices(self.measured_names)]
        columns = [
            np.log(values) if self.positive(name) else values
            for name, values in zip(self.measured_names, columns, strict=True)
        ]
        return np.stack(columns, axis=1) if columns else np.empty((len(theta), 0))

    @property
    def limits(self) -> tuple[Array, Array]:
        """How far parameters are searched, (p,) each."""
        low, high = self.ranges
        spare = _MARGIN * (high - low)
        physical = np.where(low >= 0, np.maximum(low / 2, 1e-3 * spare), -np.inf)
        ends = np.stack([np.maximum(low - spare, physical), high + spare])
        for i, name in enumerate(self.prior):
            ends[:, i] = self.search_limits.get(name, ends[:, i])
        return ends[0], ends[1]

    def check_value(self, name: str, value: Any) -> float:
        """A parameter's value, or ``ValueError`` where the simulator was not made for it."""
        (i,) = self.indices((name,))
        low, high = (float(end[i]) for end in self.limits)
        unit = split(name)[1]
        first = f"Give it in {unit}, or describe" if unit else "Describe"
        remedy = f"{first} a plant with a wider prior, or search_limits."
        return validation.number(name, value, at_least=low, at_most=high, remedy=remedy)

    def positive(self, name: str) -> bool:
        """Whether the whole range of a parameter is above 0."""
        low, _ = self.prior[name]
        return low > 0

    def label(self, name: str) -> str:
        """A parameter's name in logs, checks and results, with its unit."""
        return self.labels.get(name, name)

    def _open(self, name: str) -> bool:
        low, high = self.prior[name]
        return low < high
