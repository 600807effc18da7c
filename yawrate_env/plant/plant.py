"""A plant, described by what the two-stage method needs: prior, simulator, design rule.

Everything is batched, ``(B, ...)``; functions that take one plant at a time are called in a
loop.  `docs/plants.md` says what each function must do.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre import Laguerre
from yawrate_env import validation
from yawrate_env.compiled import LANES, over_blocks
from yawrate_env.plant.calls import called
from yawrate_env.plant.checks import check_settings
from yawrate_env.plant.metric import Figure
from yawrate_env.plant.names import split
from yawrate_env.plant.parametrisation import LOG, Coordinates
from yawrate_env.plant.responses import ClosedLoop
from yawrate_env.plant.reward import UNSTABLE, graded
from yawrate_env.plant.trial import check_functions
from yawrate_env.signals.noise import add_white_noise

Array = NDArray[np.float64]
Words = NDArray[np.uint64]
Noise = float | Callable[[Array], Array]
Search = Callable[[Array, Array, Array], tuple[Array, NDArray[np.bool_]]]
Range = tuple[float, float]

_DECIBELS = 400.0  # beyond float64's digits, either way
_MARGIN = 0.5  # of a range's width, by which the search for parameters may leave the prior


def snr(decibels: float) -> Callable[[Array], Array]:
    """Noise at so many decibels below each noise-free output's mean square."""
    given = validation.number("snr", decibels, at_least=-_DECIBELS, at_most=_DECIBELS,
                              remedy="Give a ratio in dB.")  # fmt: skip
    return _Below(10 ** (-given / 20))


@dataclass(frozen=True, slots=True)
class _Below:
    """Standard deviations at a ratio to outputs' root mean squares."""

    ratio: float

    def __call__(self, y: Array) -> Array:
        return np.asarray(self.ratio * np.sqrt((y**2).mean(axis=1)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plant:
    """A family of plants, the experiment on them, and the rule that knows their gains.

    One trial call of each function is made when a plant is described, with the
    parameters in the middle of the prior; what is wrong raises ``ValueError``.

    Attributes
    ----------
    prior : dict
        Names of the p parameters that differ from plant to plant to their uniform ranges
        ``(low, high)``; a point is a parameter that is known.
    simulate : callable
        ``simulate(theta, u, rng)``: parameters (B, p) and input (N,) to outputs (B, N); input
        (B, N) where every episode has its own (`excite`).  `rng` is for what is random in the
        plant itself; where it is None, nothing is.
    design : callable
        ``design(theta)``: parameters (B, p) to gains (B, k); ``nan`` where there are none.
    gains : tuple of str
        Their names.
    u : array
        (N,) input of the experiment.
    Ts : float
        Its sampling time [s].
    noise : float or callable
        Standard deviation of the measurement's white noise, or a function of noise-free
        outputs (B, N) to (B,): see `snr`.
    judge : callable, optional
        ``judge(theta, gains)``: parameters (B, p) and gains (B, k) to figures (B, f), by
        which gains are judged; ``nan`` where the loop is unstable, ``inf`` where it is stable
        and a figure undefined.  What the design rule reaches is the target.  Without a
        judge the gains' relative errors are the figures.
    figures : dict
        The figures' names to the errors that count as one, or to a `Figure`; without a
        judge the gains' names to relative errors, 0.3 by default.
    target : tuple of float, optional
        The figures that the design rule aims at, where these are the same for every plant.
    coordinates : Coordinates
        What the learner predicts: the gains' logarithms, or `loop` coordinates.
    measured : dict, optional
        Parameters that are known of every recording, a speed or a load, say, to how far
        outside the prior's range they may lie.
    excite : callable, optional
        ``excite(words)``: random 64-bit words (B,) to inputs (B, N), where every episode has
        an input of its own; `u` is then an example.
    linear : bool
        Whether responses add up: what a recording's start and offsets contribute can then be
        told from the response to its input.
    crossover : float, optional
        Where a loop's figures are decided [Hz]: noise is looked at around it, and with a
        linear plant the response.
    plausible : tuple of float
        Largest absolute input and output that a recording can hold: beyond, its units are
        doubted.
    batched : bool
        Whether the functions take B plants at once, or ``(p,)`` and ``(k,)`` of one.
    signals : tuple of str
        What input and output are called in pictures and logs.  Their units, and those of measured
        parameters, are in brackets: ``speed [rad/s]``.
    entry : str
        ``module:attribute`` where the description is found again; saved tuners name it.
    record : callable, optional
        For speed: ``record(theta, u, keys)``, simulation and noise in one, for inputs (1, N) or
        (B, N) and the noise streams (B, 4) of `yawrate_env.signals.noise`.
    gray_box : callable, optional
        For speed: ``gray_box(u, y, theta)``, a search for the parameters behind outputs
        (B, N), from (B, p), instead of that by differences; gives (B, p) and whether it
        converged (B,).
    search_limits : dict, optional
        Parameters to how far they are searched; by default half a range beyond the prior,
        parameters that are positive staying so.
    reach : callable, optional
        ``reach()``: lowest and highest coordinates, (m,) each, that agents choose from; by
        default what the prior's plants need and a quarter more (`yawrate_env.plant.action_bounds`).
    loop : callable, optional
        ``loop(theta, gains)``, of one plant: parameters (p,) and gains (k,) to the `ClosedLoop`
        that reports draw.
    black_box : Laguerre, optional
        Functions that explain every plant; otherwise so many as it takes, with a pole that
        suits the prior.
    """

    prior: Mapping[str, Range]
    simulate: Callable[[Array, Array, Any], Array]
    design: Callable[[Array], Array]
    gains: tuple[str, ...]
    u: Array
    Ts: float
    noise: Noise = 0.0
    judge: Callable[[Array, Array], Array] | None = None
    figures: Mapping[str, float | Figure] = field(default_factory=dict)
    target: tuple[float, ...] | None = None
    coordinates: Coordinates = LOG
    measured: Mapping[str, float] = field(default_factory=dict)
    excite: Callable[[Words], Array] | None = None
    linear: bool = False
    crossover: float | None = None
    plausible: tuple[float, float] = (np.inf, np.inf)
    batched: bool = True
    signals: tuple[str, str] = ("u", "y")
    entry: str = ""
    record: Callable[[Array, Array, Words], Array] | None = None
    gray_box: Search | None = None
    search_limits: Mapping[str, Range] = field(default_factory=dict)
    reach: Callable[[], tuple[Array, Array]] | None = None
    loop: Callable[[Array, Array], ClosedLoop] | None = None
    black_box: Laguerre | None = None

    def __post_init__(self) -> None:
        check_settings(self)
        check_functions(self)

    @property
    def ranges(self) -> tuple[Array, Array]:
        """Low and high ends of the prior, (p,) each."""
        low, high = np.array(list(self.prior.values())).T
        return low, high

    @property
    def width(self) -> Array:
        """Of the unknown parameters' ranges, (q,)."""
        low, high = self.ranges
        return np.asarray((high - low)[self.unknown])

    @property
    def middle(self) -> Array:
        """(1, p) parameters in the middle of the prior."""
        low, high = self.ranges
        return np.asarray((low + high)[None] / 2)

    @property
    def unknown(self) -> NDArray[np.intp]:
        """(q,) which parameters a recording must tell: neither measured nor a point."""
        return np.flatnonzero([n not in self.measured and self._open(n) for n in self.prior])

    @property
    def known(self) -> NDArray[np.intp]:
        """(p - q,) all other parameters."""
        return np.setdiff1d(np.arange(len(self.prior)), self.unknown)

    @property
    def shown_names(self) -> tuple[str, ...]:
        """The measured parameters that the prior leaves open."""
        return tuple(name for name in self.prior if name in self.measured and self._open(name))

    def places(self, names: Iterable[str]) -> list[int]:
        """Where parameters of these names stand among the p."""
        return [list(self.prior).index(name) for name in names]

    def shown(self, theta: Array) -> Array:
        """These (B, m), in logarithms where positive: features beside the recording's own."""
        columns = [theta[:, i] for i in self.places(self.shown_names)]
        columns = [
            np.log(values) if self.prior[name][0] > 0 else values
            for name, values in zip(self.shown_names, columns, strict=True)
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

    def possible(self, name: str, value: Any) -> float:
        """A parameter's value, or ``ValueError`` where the simulator was not made for it."""
        (i,) = self.places((name,))
        low, high = (float(end[i]) for end in self.limits)
        unit = split(name)[1]
        first = f"Give it in {unit}, or describe" if unit else "Describe"
        remedy = f"{first} a plant with a wider prior, or search_limits."
        return validation.number(name, value, at_least=low, at_most=high, remedy=remedy)

    def respond(self, theta: Array, u: Array | None = None, rng: Any = None) -> Array:
        """Outputs (B, N) without measurement noise, by default of the experiment's input.

        Parameters
        ----------
        u : (N,), (1, N) or (B, N) float64, optional
            One input for all, or one for each.
        """
        given = np.atleast_2d(self.u if u is None else u)
        own = (given,) if len(given) > 1 else ()

        def simulated(t: Array, v: Array | None = None) -> Array:
            return self.simulate(t, given[0].copy() if v is None else v, rng)

        return self._each("simulate", simulated, given.shape[1], theta, *own)

    def inputs(self, words: Words) -> Array:
        """Inputs of B experiments, (1, N) or (B, N), from a random word each."""
        if self.excite is None:
            return self.u[None]
        u = validation.float_array("excite's answer", called("excite", self.excite, words))
        if u.ndim != 2:
            raise ValueError(f"excite gave shape {u.shape}. Give an input for each word, (B, N).")
        return u

    def measure(self, theta: Array, u: Array, keys: Words, rng: Any = None) -> Array:
        """Measured outputs (B, N) for inputs (1 or B, N), each noise from its own key (B, 4)."""
        if self.record is not None:
            return np.asarray(called("record", self.record, theta, u, keys))
        clean = np.ascontiguousarray(self.respond(theta, u, rng))
        sigma = self.sigma(clean).copy()
        measured = np.empty_like(clean)

        def work(i: int, j: int) -> None:
            add_white_noise(clean[i:j], sigma[i:j], keys[i:j], measured[i:j])

        over_blocks(work, len(clean), LANES)
        return measured

    def sigma(self, clean: Array) -> Array:
        """Standard deviations of the measurement noise, (B,)."""
        value = called("noise", self.noise, clean) if callable(self.noise) else self.noise
        sigma = validation.float_array("noise's answer", value)
        if sigma.shape not in ((), (1,), (len(clean),)):
            raise ValueError(f"noise gave shape {sigma.shape}, wanted {(len(clean),)}.")
        return np.broadcast_to(sigma, len(clean))

    def oracle(self, theta: Array) -> Array:
        """Gains (B, k) of the design rule that knows the parameters."""
        return self._each("design", self.design, len(self.gains), theta)

    def judged(self, theta: Array, gains: Array) -> Array:
        """Figures (B, f) of gains; ``nan`` where there are no gains or the loop is unstable."""
        if self.judge is None:
            with np.errstate(divide="ignore", invalid="ignore"):
                return np.asarray(gains / self.oracle(theta) - 1)
        usable, f = np.isfinite(gains).all(axis=1), len(self.figures)
        figures = np.full((len(theta), f), np.nan)
        if usable.any():
            figures[usable] = self._each("judge", self.judge, f, theta[usable], gains[usable])
        return figures

    def wanted(self, theta: Array) -> Array:
        """Figures (B, f) that the design rule aims at, or else what it reaches."""
        if self.target is not None:
            return np.tile(np.array(self.target), (len(theta), 1))
        return self.judged(theta, self.oracle(theta))

    def closed(self, theta: Array, gains: Array) -> ClosedLoop | None:
        """The loop of gains (k,) around one plant (p,); None where there is nothing to draw."""
        if self.loop is None or not np.isfinite(gains).all():
            return None
        drawn = called("loop", self.loop, theta.copy(), gains.copy())
        remedy = "Give responses, an open loop, or both."
        validation.instance("loop's answer", drawn, ClosedLoop, remedy=remedy)
        return drawn  # type: ignore[no-any-return]

    def errors(self, theta: Array, gains: Array) -> Array:
        """Figures' distances from those wanted, (B, f), in units of their own."""
        return np.asarray(self.judged(theta, gains) - self.wanted(theta))

    def reward(self, theta: Array, gains: Array) -> Array:
        """Reward (B,) between -5 and 0, graded as the yaw-rate environment's is."""
        return self.earned(self.errors(theta, gains))

    def earned(self, errors: Array) -> Array:
        """Reward (B,) of figures' distances from those wanted (B, f)."""
        e = np.sqrt(((errors / self.figure("scale")) ** 2).sum(axis=1))
        return np.where(np.isnan(e), UNSTABLE, graded(e))

    def figure(self, of: str) -> Array:
        """(f,) ``scale``, ``error`` or ``spread`` of the figures."""
        return np.array([getattr(figure, of) for figure in self.figures.values()])

    def _open(self, name: str) -> bool:
        low, high = self.prior[name]
        return low < high

    def _each(self, name: str, function: Callable[..., Any], width: int, *arrays: Array) -> Array:
        """Call for the batch, or for one at a time, and check the shape."""
        arrays = tuple(array.copy() for array in arrays)  # theirs to write into
        answer = f"{name}'s answer"
        if self.batched:
            values = validation.float_array(answer, called(name, function, *arrays))
        else:
            each = (called(name, function, *row) for row in zip(*arrays, strict=True))
            rows: Any = [validation.float_array(answer, row) for row in each]
            values = validation.float_array(answer, rows)
        if values.shape != (len(arrays[0]), width):
            raise ValueError(f"{name} gave shape {values.shape}, wanted {(len(arrays[0]), width)}.")
        return values
