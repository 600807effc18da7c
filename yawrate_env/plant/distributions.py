"""Distributions of a plant's parameters: uniform, logarithmic, normal, and any of SciPy's."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation

Array = NDArray[np.float64]
Range = tuple[float, float]

_DEVIATIONS = 3.0  # of a normal prior, beyond which it is cut off
_BEYOND = 0.00135  # share on either side that is cut off of others


class Uniform(tuple[float, float]):
    """A uniform prior: the pair ``(low, high)``."""

    __slots__ = ()

    kind: ClassVar[str] = ""
    words: ClassVar[str] = ""

    @property
    def middle(self) -> float:
        """The mean of its ends."""
        low, high = self
        return (low + high) / 2

    @property
    def plain(self) -> Any:
        """What `spread` reads, of plain JSON values."""
        return tuple(self)

    def at(self, unit: Array) -> Array:
        """Quantiles (B,) of uniform numbers (B,) between 0 and 1."""
        low, high = self
        return np.asarray(low + (high - low) * unit)


@dataclass(frozen=True, slots=True)
class LogRange:
    """A prior whose logarithm is uniform between two positive ends; unpacks as ``(low, high)``.

    Attributes
    ----------
    low, high : float
        Ends of the range, in the parameter's unit.
    """

    kind: ClassVar[str] = "log"
    words: ClassVar[str] = "uniform in its logarithm"

    low: float
    high: float

    def __post_init__(self) -> None:
        remedy = "Give positive ends, or a pair for a uniform prior."
        for end in ("low", "high"):
            value = validation.number(f"LogRange {end}", getattr(self, end), above=0.0,
                                      remedy=remedy)  # fmt: skip
            object.__setattr__(self, end, value)
        validation.interval("LogRange", tuple(self))

    def __iter__(self) -> Iterator[float]:
        return iter((self.low, self.high))

    @property
    def middle(self) -> float:
        """The geometric mean of its ends."""
        return float(np.sqrt(self.low) * np.sqrt(self.high))

    @property
    def plain(self) -> Any:
        """What `spread` reads, of plain JSON values."""
        return {self.kind: [self.low, self.high]}

    def at(self, unit: Array) -> Array:
        """Quantiles (B,) of uniform numbers (B,) between 0 and 1."""
        return np.asarray(self.low * np.exp(unit * np.log(self.high / self.low)))


@dataclass(frozen=True, slots=True)
class Normal:
    """A normal prior, cut off at three deviations: it unpacks as these ends, ``(low, high)``.

    Attributes
    ----------
    mean, deviation : float
        Of the distribution before it is cut off, in the parameter's unit.
    """

    kind: ClassVar[str] = "normal"
    words: ClassVar[str] = "normal"

    mean: float
    deviation: float

    def __post_init__(self) -> None:
        mean = validation.number("Normal mean", self.mean)
        deviation = validation.number("Normal deviation", self.deviation, above=0.0,
                                      remedy="Give a number for a known parameter.")  # fmt: skip
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "deviation", deviation)

    def __iter__(self) -> Iterator[float]:
        spare = _DEVIATIONS * self.deviation
        return iter((self.mean - spare, self.mean + spare))

    @property
    def middle(self) -> float:
        """The mean."""
        return self.mean

    @property
    def plain(self) -> Any:
        """What `spread` reads, of plain JSON values."""
        return {self.kind: [self.mean, self.deviation]}

    def at(self, unit: Array) -> Array:
        """Quantiles (B,) of uniform numbers (B,) between 0 and 1."""
        standard = NormalDist()
        outside = standard.cdf(-_DEVIATIONS)
        shares = outside + (1 - 2 * outside) * unit
        return self.mean + self.deviation * np.array([standard.inv_cdf(x) for x in shares.tolist()])


@dataclass(frozen=True, slots=True)
class Distribution:
    """Any continuous distribution of SciPy; unpacks as the ends between which values are drawn.

    Where it has a tail without end, a share of 0.135 % is cut off on either side, as beyond three
    deviations of a normal one.

    Attributes
    ----------
    kind : str
        Name in ``scipy.stats``.
    settings : tuple
        Names and values of its parameters: shapes, ``loc``, ``scale``.
    """

    kind: str
    settings: tuple[tuple[str, float], ...]

    def __post_init__(self) -> None:
        from scipy import stats

        found = getattr(stats, self.kind, None)
        if not isinstance(found, stats.rv_continuous):
            raise ValueError(
                f"distribution = {self.kind!r} is no continuous one of scipy.stats. Choose one, as "
                "in {lognorm = {s = 0.5, scale = 2.0}}."
            )
        try:
            ends = np.array(tuple(self))
        except TypeError as error:
            raise ValueError(f"{self.kind}: {error}.") from None
        if not (np.isfinite(ends).all() and ends[0] < ends[1]):
            raise ValueError(
                f"{self.kind} with {dict(self.settings)} has no width, or values that are no "
                "numbers. Give other parameters."
            )

    @classmethod
    def of(cls, frozen: Any) -> "Distribution":
        """That of a frozen random variable, ``scipy.stats.lognorm(0.5, scale=2.0)``."""
        law = frozen.dist
        shapes = [name.strip() for name in (law.shapes or "").split(",") if name.strip()]
        given = dict(zip([*shapes, "loc", "scale"], frozen.args, strict=False)) | frozen.kwds
        return cls(law.name, tuple((name, float(value)) for name, value in given.items()))

    def __iter__(self) -> Iterator[float]:
        return iter(self.at(np.array([0.0, 1.0])).tolist())

    @property
    def words(self) -> str:
        """Its name and parameters, for people."""
        return " ".join(
            [self.kind, ", ".join(f"{name} {value:g}" for name, value in self.settings)]
        )

    @property
    def middle(self) -> float:
        """The median."""
        return float(self.at(np.array([0.5]))[0])

    @property
    def plain(self) -> Any:
        """What `spread` reads, of plain JSON values."""
        return {self.kind: dict(self.settings)}

    def at(self, unit: Array) -> Array:
        """Quantiles (B,) of uniform numbers (B,) between 0 and 1."""
        from scipy import stats

        law = getattr(stats, self.kind)(**dict(self.settings))
        beyond = _BEYOND if np.isinf(law.support()).any() else 0.0
        return np.asarray(law.ppf(beyond + (1 - 2 * beyond) * unit), dtype=np.float64)


Spread = Range | LogRange | Normal | Distribution
"""A parameter's prior as it may be given: uniform between two ends, or one of the others."""

Shape = Uniform | LogRange | Normal | Distribution
"""A parameter's prior, as `spread` gives it."""

SHAPES: dict[str, type[LogRange] | type[Normal]] = {"log": LogRange, "normal": Normal}
"""Those of two numbers, by the name that files have for them."""


def spread(name: str, value: Any) -> Shape:
    """A prior from a number, a pair, a record, a frozen variable of SciPy or a file's mapping.

    Files have ``{"log": [low, high]}`` and ``{"lognorm": {"s": 0.5, "scale": 2.0}}``.
    """
    if isinstance(value, LogRange | Normal | Distribution):
        return value
    try:
        if hasattr(value, "dist") and hasattr(value, "ppf"):
            return Distribution.of(value)
        if not isinstance(value, Mapping):
            return Uniform(validation.interval(name, value))
        shape, *others = value or ("",)
        if not others and isinstance(value.get(shape), Mapping):
            settings = value[shape].items()
            return Distribution(
                shape, tuple((of, validation.number(of, each)) for of, each in settings)
            )
        if not others and shape in SHAPES and np.size(value[shape]) == 2:
            return SHAPES[shape](*value[shape])
    except ValueError as error:
        named = str(error).startswith(name)
        raise ValueError(str(error) if named else f"{name}: {error}") from None
    raise ValueError(
        f"{name} = {dict(value)!r} is no prior. Give a number, [low, high], "
        "{log = [low, high]}, {normal = [mean, deviation]} or a distribution of scipy.stats with "
        "its parameters, {lognorm = {s = 0.5, scale = 2.0}}."
    )
