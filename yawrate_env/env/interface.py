"""The interface of plant and agent: what is observed of episodes, and the outcome of gains.

Everything is batched; the scalar environment is a batch of one.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from yawrate_env import validation
from yawrate_env.compiled import LANES, over_blocks
from yawrate_env.plant.action_bounds import action_bounds, corners
from yawrate_env.plant.episodes import Draw, integers_of, prior_gains
from yawrate_env.plant.names import MARGINS, ORACLE, split
from yawrate_env.plant.observations import complete
from yawrate_env.plant.parametrisation import scale_to_bounds
from yawrate_env.plant.plant import Plant
from yawrate_env.plant.reward import defined
from yawrate_env.signals.decimation import averaged
from yawrate_env.signals.streams import uniform

Array = NDArray[np.float64]
Observation = NDArray[np.float32]
Info = dict[str, NDArray[Any]]

_LARGEST = 1e30  # finite, as agents require, and beyond any unit

COST = "cost"
"""The info's entry for constrained learning: 1 where a loop is (nearly) unstable, else 0."""

LEAST_MARGIN = 45.0
"""Phase margin below which a loop costs [deg]."""

WIDTH = "width"
"""Option of ``reset``: the share of every parameter's distribution that plants are drawn from."""


@dataclass(frozen=True, slots=True, eq=False)
class Interface:
    """What an agent observes of a plant's episodes, and what it chooses.

    Attributes
    ----------
    plant : Plant
        Episodes and rewards are its.
    observation_space : Box
        (2 + m, samples) float32: input, measured output, and the visible parameters, constant
        in time; of several channels all inputs come first, then all outputs.  Outputs are clipped
        to it.
    action_space : Box
        (k,) float64, gains.
    visible : tuple of str
        Names of the m visible parameters.
    features_of : callable
        Parameters (B, p) to those features (B, m) that the visible ones are, beside a
        recording's own.
    check_pin : callable
        ``check_pin(name, value)`` raises ``ValueError`` where `reset` cannot pin a parameter to
        a value.
    decimate : int
        Observations are averages over blocks of so many samples.
    unmasked : bool
        Whether the info has the metrics of unstable loops as they are evaluated; otherwise they
        are ``nan``, and ``inf`` where the loop is stable and a metric is undefined.
    basis : tuple, optional
        Order and pole [rad/s] of the Laguerre features that agents observe; suited to the plant
        if omitted.
    """

    plant: Plant
    observation_space: Box
    action_space: Box
    visible: tuple[str, ...]
    features_of: Callable[[Array], Array]
    check_pin: Callable[[str, float], Any]
    decimate: int = 1
    unmasked: bool = False
    basis: tuple[int, float] | None = None

    @classmethod
    def of(cls, plant: Plant) -> Self:
        """The default: measured parameters are visible, gains are those that the prior needs."""
        shape = (plant.rows + len(plant.measured_names), plant.samples)
        return cls(
            plant,
            Box(-_LARGEST, _LARGEST, shape, dtype=np.float32),
            action_box(plant),
            plant.measured_names,
            plant.measured_features,
            plant.check_value,
        )

    @property
    def integers(self) -> int:
        """How many random 64-bit integers an episode takes."""
        return integers_of(self.plant)

    @property
    def Ts(self) -> float:
        """Sampling time of the observations [s]."""
        return self.plant.Ts * self.decimate

    def pins(self, options: Mapping[str, Any], count: int) -> dict[str, Array]:
        """Parameters (count,) that the options of ``reset`` pin, checked."""
        pins: dict[str, Array] = {}
        for name, value in options.items():
            validation.one_of("reset option", name, (*self.plant.prior, WIDTH))
            values = validation.float_array(f"reset option {name}", value)
            if values.shape not in ((), (1,), (count,)):
                raise ValueError(
                    f"reset option {name} has shape {values.shape}. Give one number"
                    + (f", or {count}." if count > 1 else ".")
                )
            check = self.check_pin if name in self.plant.prior else check_width
            for one in values.flat:
                check(name, float(one))
            pins[name] = np.broadcast_to(values, (count,))
        return pins

    def begin(
        self,
        integers: NDArray[np.uint64],
        pins: Mapping[str, Array],
        rng: np.random.Generator,
        out: Observation,
        copy: Observation | None = None,
    ) -> Array:
        """Parameters (B, p) of episodes from random integers (B, n).

        Parameters
        ----------
        out : (B, 2 + m, samples) float32
            Where the observations are written.
        copy : (B, 2 + m, samples) float32, optional
            Where they are written as well.
        """
        pins, plant = dict(pins), self.plant
        width = None if WIDTH in self.plant.prior else pins.pop(WIDTH, None)
        draw = Draw.of(self.plant, narrowed(self.plant, integers, width))
        for i, values in zip(self.plant.indices(pins), pins.values(), strict=True):
            draw.theta[:, i] = values
        obs = out if self.decimate == 1 else self._empty(len(out))
        rest = self._rest(obs, draw.u, draw.theta, copy)
        plant.measure(draw.theta, draw.u, draw.keys, rng, plant.outputs_in(obs), rest)
        if not rest.within.all():
            self._check_finite(draw.theta, plant.outputs_in(obs))
            self._clip(obs)
        if obs is not out:
            out[...] = averaged(obs, self.decimate)
        if copy is not None and not (obs is out and rest.within.all()):
            copy[...] = out
        return draw.theta

    def observe(self, u: Array, y: NDArray[np.floating], theta: Array) -> Observation:
        """Observations of episodes that are already recorded.

        Parameters
        ----------
        u : (1, N) or (B, N)
            Inputs; of several (…, m, N).
        y : (B, N)
            Measured outputs; of several (B, q, N).
        theta : (B, p)
            Parameters, of which only the visible ones are used.
        """
        obs = self._empty(len(y))
        self.plant.outputs_in(obs)[:] = y
        rest = self._rest(obs, u[None] if u.ndim == self.plant.u.ndim else u, theta)
        over_blocks(rest, len(obs), LANES)
        if not rest.within.all():
            self._clip(obs)
        return obs if self.decimate == 1 else averaged(obs, self.decimate).astype(np.float32)

    def recordings(self, obs: ArrayLike) -> tuple[Array, Array, Array]:
        """Inputs (1 or B, N), outputs (B, N) and parameters (B, p) of observations (B, rows, N).

        Of several channels inputs are (1 or B, m, N), and outputs (B, q, N).  Parameters that are
        not visible are those in the middle of the prior.
        """
        array, shape = validation.real_array("obs", obs), self.observation_space.shape
        if array.shape[1:] != shape:
            raise ValueError(
                f"obs has shape {array.shape}. Give (B, {shape[0]}, {shape[1]}), as this "
                "environment does."
            )
        theta = np.tile(self.plant.middle, (len(array), 1))
        theta[:, self.plant.indices(self.visible)] = array[:, self.plant.rows :, 0]
        return *self.plant.recordings_in(array), theta

    def outcome(self, theta: Array, actions: Array) -> tuple[Array, Info]:
        """Rewards (B,) of actions (B, k), and the info with the truth, arrays (B,)."""
        plant, space = self.plant, self.action_space
        gains = np.clip(actions, space.low, space.high)
        values, stable = plant.evaluation(theta, gains)
        oracle = plant.oracle(theta)
        metrics = values if self.unmasked else defined(values, stable)
        info = {
            **dict(zip(plant.gains, gains.T, strict=True)),
            "clipped": (gains != actions).any(axis=1),
            **{split(name)[0]: of for name, of in zip(plant.metrics, metrics.T, strict=True)},
            "stable": stable,
            **self._cost(values, stable),
            **{ORACLE + name: of for name, of in zip(plant.gains, oracle.T, strict=True)},
            **dict(zip(plant.prior, theta.T, strict=True)),
        }
        errors = plant.counted_values(values, stable) - plant.targets(theta)
        return plant.reward_of(errors), info

    def _cost(self, values: Array, stable: NDArray[np.bool_]) -> Info:
        """`COST` (B,), unless the plant has a name of its own like it."""
        plant, (margin, _) = self.plant, MARGINS
        names = [split(name)[0] for name in plant.metrics]
        if COST in (*plant.gains, *names, *plant.prior):
            return {}
        low = ~stable
        if margin in names:
            # Without a crossover there is no margin to fall below.
            low = low | (values[:, names.index(margin)] < LEAST_MARGIN)
        return {COST: low.astype(np.float64)}

    def _empty(self, count: int) -> Observation:
        rows = self.plant.rows + len(self.visible)
        return np.empty((count, rows, self.plant.samples), dtype=np.float32)

    def _rest(
        self, obs: Observation, u: Array, theta: Array, copy: Observation | None = None
    ) -> "_Rest":
        visible = theta[:, self.plant.indices(self.visible), None]
        several = u.reshape(len(u), -1, u.shape[-1])
        return _Rest(obs, several, visible, *self._output_bounds, copy)

    def _clip(self, obs: Observation) -> None:
        low, high = (end[:, None] for end in self._output_bounds)
        outputs = obs[:, self.plant.output_rows]
        np.clip(outputs, low, high, out=outputs)

    @property
    def _output_bounds(self) -> tuple[Observation, Observation]:
        space, rows = self.observation_space, self.plant.output_rows
        low, high = (end[rows, 0].astype(np.float32) for end in (space.low, space.high))
        return low, high

    def _check_finite(self, theta: Array, y: Observation) -> None:
        if np.isfinite(y).all():
            return
        worst = int(np.argmin(np.isfinite(y).reshape(len(y), -1).all(axis=1)))
        names = zip(self.plant.prior, theta[worst], strict=True)
        raise ValueError(
            f"The output with {', '.join(f'{name} = {value:.4g}' for name, value in names)} is "
            "not finite: this plant is unstable. Choose other parameters, or check the simulator."
        )


class _Rest:
    """The rows of observations around the outputs, written while a block is in the cache.

    Parameters
    ----------
    obs : (B, rows, N) float32
        Outputs are there already.
    u : (1, m, N) or (B, m, N) float64
        Inputs.
    visible : (B, v, 1) float64
        The visible parameters.
    low, high : (q,) float32
        Bounds of the outputs.
    copy : (B, rows, samples) float32, optional
        Where observations are written as well.

    Attributes
    ----------
    within : NDArray
        (B,) whether all of an episode's output lies within the bounds.
    """

    def __init__(
        self,
        obs: Observation,
        u: Array,
        visible: Array,
        low: Observation,
        high: Observation,
        copy: Observation | None = None,
    ) -> None:
        self._obs, self._u, self._visible, self._copy = obs, u, visible, copy
        self._bounds = low, high
        self.within = np.zeros(len(obs), dtype=np.bool_)

    def __call__(self, i: int, j: int) -> None:
        """Complete episodes i to j."""
        obs, u = self._obs[i:j], self._u if len(self._u) == 1 else self._u[i:j]
        obs[:, u.shape[1] + len(self._bounds[0]) :] = self._visible[i:j]
        complete(obs, u, *self._bounds, self.within[i:j])
        if self._copy is not None and self._copy.shape == self._obs.shape:
            self._copy[i:j] = obs


def action_box(plant: Plant) -> Box:
    """Gains that the coordinates within an agent's bounds stand for."""
    low, high = action_bounds(plant)
    units = corners(-np.ones_like(low), np.ones_like(low))
    ends = plant.parametrisation.decode(scale_to_bounds(units, low, high))
    gains = np.concatenate([prior_gains(plant), ends[np.isfinite(ends).all(axis=1)]])
    return Box(gains.min(axis=0), gains.max(axis=0), dtype=np.float64)


def narrowed(plant: Plant, integers: NDArray[np.uint64], width: Array | None) -> NDArray[np.uint64]:
    """Random integers of episodes whose parameters lie within a share (B,) of their distributions.

    The middle of every distribution stays: of a uniform one with half the range is left for 0.5.
    """
    if width is None:
        return integers
    p, steps = len(plant.prior), 2.0**53
    unit = 0.5 + width[:, None] * (uniform(integers[:, :p]) - 0.5)
    near = (np.minimum(unit * steps, steps - 1)).astype(np.uint64) << np.uint64(11)
    parameters = np.where(width[:, None] == 1, integers[:, :p], near)
    return np.concatenate([parameters, integers[:, p:]], axis=1)


def check_width(name: str, value: float) -> None:
    """``ValueError`` where a width is not between 0 and 1."""
    remedy = "1 draws from the whole prior, 0 its middle."
    validation.number(f"reset option {name}", value, at_least=0.0, at_most=1.0, remedy=remedy)


def copied(options: Mapping[str, Any] | None) -> dict[str, Any]:
    """A copy of the options of ``reset``, or ``ValueError``."""
    if not isinstance(options, Mapping | None):
        raise ValueError(
            f"reset options = {options!r} are not a dictionary. Give {{name: value}}, or None."
        )
    return dict(options or {})
