"""A plant, described by what the two-stage method needs: prior, simulator, design rule.

Everything is batched, ``(B, ...)``; functions that take one plant at a time are called in a
loop.  `docs/plants.md` says what each function must do.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tuners.plants.coordinates import LOG, Coordinates
from yawrate_env import validation
from yawrate_env.noise import add_white_noise
from yawrate_env.reward import UNSTABLE, graded

Array = NDArray[np.float64]
Noise = float | Callable[[Array], Array]

RELATIVE_ERROR = 0.3
"""Of a gain: what counts as one where the plant has no judge."""

_MARGIN = 0.5  # of a range's width, by which the search for parameters may leave the prior


def snr(decibels: float) -> Callable[[Array], Array]:
    """Noise at so many decibels below each noise-free output's mean square."""
    ratio = 10 ** (-validation.number("snr", decibels, remedy="Give a ratio in dB.") / 20)
    return lambda y: np.asarray(ratio * np.sqrt((y**2).mean(axis=1)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plant:
    """A family of plants, the experiment on them, and the rule that knows their gains.

    One trial call of each function is made when a plant is described, with the
    parameters in the middle of the prior; what is wrong raises ``ValueError``.

    Attributes
    ----------
    prior : dict
        Names of the p unknown parameters to their uniform ranges ``(low, high)``.
    simulate : callable
        ``simulate(theta, u, rng)``: parameters (B, p) and input (N,) to outputs (B, N).
        `rng` is for what is random in the plant itself; where it is None, nothing is.
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
        The figures' names to the errors that count as one.
    coordinates : Coordinates
        What the learner predicts: the gains' logarithms, or `loop` coordinates.
    batched : bool
        Whether the functions take B plants at once, or ``(p,)`` and ``(k,)`` of one.
    signals : tuple of str
        What input and output are called in pictures.
    entry : str
        ``module:attribute`` where the description is found again; saved tuners name it.
    """

    prior: Mapping[str, tuple[float, float]]
    simulate: Callable[[Array, Array, Any], Array]
    design: Callable[[Array], Array]
    gains: tuple[str, ...]
    u: Array
    Ts: float
    noise: Noise = 0.0
    judge: Callable[[Array, Array], Array] | None = None
    figures: Mapping[str, float] = field(default_factory=dict)
    coordinates: Coordinates = LOG
    batched: bool = True
    signals: tuple[str, str] = ("u", "y")
    entry: str = ""

    def __post_init__(self) -> None:
        _check_settings(self)
        if self.judge is None:
            figures = {f"relative error of {name}": RELATIVE_ERROR for name in self.gains}
            object.__setattr__(self, "figures", figures)
        _check_functions(self)

    @property
    def ranges(self) -> tuple[Array, Array]:
        """Low and high ends of the prior, (p,) each."""
        low, high = np.array(list(self.prior.values())).T
        return low, high

    @property
    def middle(self) -> Array:
        """(1, p) parameters in the middle of the prior."""
        low, high = self.ranges
        return np.asarray((low + high)[None] / 2)

    @property
    def search_limits(self) -> tuple[Array, Array]:
        """How far parameters are searched, (p,) each; what is positive stays so."""
        low, high = self.ranges
        spare = _MARGIN * (high - low)
        physical = np.where(low >= 0, np.maximum(low / 2, 1e-3 * spare), -np.inf)
        return np.maximum(low - spare, physical), high + spare

    def respond(self, theta: Array, u: Array | None = None, rng: Any = None) -> Array:
        """Outputs (B, N) without measurement noise, by default of the experiment's input."""
        given = self.u if u is None else u
        return self._each(lambda t: self.simulate(t, given, rng), len(given), theta)

    def record(self, theta: Array, keys: NDArray[np.uint64], rng: Any) -> Array:
        """Measured outputs (B, N) of the experiment, each noise from its own key (B, 4)."""
        clean = np.ascontiguousarray(self.respond(theta, rng=rng))
        sigma = np.broadcast_to(self.sigma(clean), len(clean)).copy()
        measured = np.empty_like(clean)
        add_white_noise(clean, sigma, keys, measured)
        return measured

    def sigma(self, clean: Array) -> Array:
        """Standard deviations of the measurement noise, (B,)."""
        value = self.noise(clean) if callable(self.noise) else self.noise
        return np.broadcast_to(np.asarray(value, dtype=np.float64), len(clean))

    def oracle(self, theta: Array) -> Array:
        """Gains (B, k) of the design rule that knows the parameters."""
        return self._each(self.design, len(self.gains), theta)

    def judged(self, theta: Array, gains: Array) -> Array:
        """Figures (B, f) of gains; ``nan`` where there are no gains or the loop is unstable."""
        if self.judge is None:
            with np.errstate(divide="ignore", invalid="ignore"):
                return np.asarray(gains / self.oracle(theta) - 1)
        usable = np.isfinite(gains).all(axis=1)
        figures = np.full((len(theta), len(self.figures)), np.nan)
        if usable.any():
            found = self._each(self.judge, len(self.figures), theta[usable], gains[usable])
            figures[usable] = found
        return figures

    def errors(self, theta: Array, gains: Array) -> Array:
        """Figures' distances from what the design rule reaches, (B, f), in units of their own."""
        scale = np.array(list(self.figures.values()))
        return np.asarray(
            (self.judged(theta, gains) - self.judged(theta, self.oracle(theta))) / scale
        )

    def reward(self, theta: Array, gains: Array) -> Array:
        """Reward (B,) between -5 and 0, graded as the yaw-rate environment's is."""
        e = np.sqrt((self.errors(theta, gains) ** 2).sum(axis=1))
        return np.where(np.isnan(e), UNSTABLE, graded(e))

    def _each(self, function: Callable[..., Any], width: int, *arrays: Array) -> Array:
        """Call for the batch, or for one at a time, and check the shape."""
        if self.batched:
            values = np.asarray(function(*arrays), dtype=np.float64)
        else:
            rows = [function(*row) for row in zip(*arrays, strict=True)]
            values = np.asarray(rows, dtype=np.float64)
        if values.shape != (len(arrays[0]), width):
            name = getattr(function, "__name__", "function")
            raise ValueError(f"{name} gave shape {values.shape}, wanted {(len(arrays[0]), width)}.")
        return values


def _check_settings(plant: Plant) -> None:
    """Everything that can be checked without calling anything; normalises what it can."""
    if not isinstance(plant.prior, Mapping) or not plant.prior:
        raise ValueError('prior must name at least one parameter, as in {"J": (0.01, 0.03)}.')
    prior = {name: validation.interval(f"prior {name}", r) for name, r in plant.prior.items()}
    for name, (low, high) in prior.items():
        if low == high:
            raise ValueError(
                f"prior {name} = [{low:g}, {high:g}] is a point. Make it a constant of simulate."
            )
    u: ArrayLike = validation.finite_array("u", plant.u, shape=(None,))
    Ts = validation.number("Ts", plant.Ts, above=0.0, remedy="Give the sampling time in seconds.")
    if isinstance(plant.gains, str) or not plant.gains:
        raise ValueError(f'gains = {plant.gains!r} must be names, as in ("kp", "Ti").')
    if (plant.judge is None) != (not plant.figures):
        raise ValueError(
            "judge and figures belong together. Give figures the names of what judge returns and "
            'the errors that count as one, as in {"phase margin [deg]": 10.0}.'
        )
    for name, scale in plant.figures.items():
        validation.number(f"figure {name}", scale, above=0.0, remedy="Give the error that counts.")
    if not callable(plant.noise):
        validation.number("noise", plant.noise, at_least=0.0, remedy="Give a standard deviation.")
    values = {"prior": prior, "u": u, "Ts": Ts, "gains": tuple(plant.gains)}
    for name, value in values.items():
        object.__setattr__(plant, name, value)


def _check_functions(plant: Plant) -> None:
    """One trial call of each, in the middle of the prior and for two plants at once."""
    theta = np.repeat(plant.middle, 2, axis=0)
    width, f = len(plant.u), len(plant.figures)

    def tried(name: str, call: Callable[[], Any], columns: int) -> Array:
        try:
            values = call()
        except ValueError as error:
            hint = "" if not plant.batched else " For functions of one plant set batched=False."
            raise ValueError(f"{name} failed in the middle of the prior: {error}{hint}") from error
        return validation.finite_array(f"{name} in the prior's middle", values, shape=(2, columns))

    y = tried("simulate", lambda: plant.respond(theta), width)
    if not np.array_equal(y, plant.respond(theta)):
        raise ValueError("simulate is random where rng is None. Use rng for all that is random.")
    tried("noise", lambda: plant.sigma(y)[:, None], 1)
    gains = tried("design", lambda: plant.oracle(theta), len(plant.gains))
    encoded = plant.coordinates.encode(gains)
    decoded = plant.coordinates.decode(np.asarray(encoded))
    if not np.allclose(decoded, gains, rtol=1e-6):
        raise ValueError(
            f"gains {gains[0]} do not survive coordinates' encode and decode, which give "
            f"{decoded[0]}. The default is for positive gains: give coordinates of your own."
        )
    tried("judge", lambda: plant.judged(theta, gains), f)
