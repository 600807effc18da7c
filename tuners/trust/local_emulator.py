"""Emulator of a slow nonlinear plant for the input of one recording that no training has seen.

The trained emulator knows the answers to the experiment.  Its answers as linear models, applied to
the new input, lead a search near the plant behind the recording.  There the simulator is asked:
once, and once on either side in each unknown parameter, which makes outputs of second degree.
Their minimum is simulated, and what they err there corrects their slopes (Broyden, 1965), a few
times.  Where that has led far, the outputs on either side are made anew, closer together.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre import Laguerre
from tuners.trust.black_box import BlackBox
from tuners.trust.identification import identify_from_several
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

_FAR, _CLOSE = 0.1, 0.03  # of a range: how far apart outputs are simulated, first and at the end
_SAME = 0.01  # of a range: nearer outputs tell no slopes
_MOVES = 3  # of the centre, at most
_UNSEEN = 0.03  # of the residual's energy: an emulator's error that moves nothing
_KNOWN = 1e-6  # of the largest singular value: signals that the experiment holds


def locally_emulated(plant: Plant, model: BlackBox, start: Array) -> Plant:
    """The plant with an emulator for one recording's input, or as it is where it needs none.

    It needs one if it is slow and nonlinear, has an emulator, and that does not know the input.

    Parameters
    ----------
    model : BlackBox
        Of the recording.
    start : (1, p) float64
        Where a search starts, with the measured parameters.
    """
    trained, alone = plant.emulator, len(start) == 1 and plant.channels is None
    if trained is None or plant.linear or not alone or trained.knows(model.u):
        return plant
    asked = plant.with_simulator(_Cache(plant))
    rough = plant.with_simulator(_LinearAnswers(plant, model.functions, model.Ts))
    emulator = LocalEmulator.of(asked, _minimum(rough, model, start, _FAR), model.u, _FAR)
    first = emulator.centre
    for _ in range(_MOVES):
        theta = _minimum(plant.with_simulator(emulator), model, start, _CLOSE)
        y = asked.respond(theta, model.u)
        off, left = (((each - y) ** 2).sum() for each in (emulator(theta, model.u), model.y))
        emulator = emulator.moved(theta[0], y[0])
        if off <= _UNSEEN * left:
            break
    away = np.abs(emulator.centre - first)[plant.unknown] / plant.width
    if away.max() > _FAR:
        emulator = LocalEmulator.of(asked, emulator.centre[None], model.u, _CLOSE)
    return plant.with_simulator(asked.simulate, emulator)


def _minimum(rough: Plant, model: BlackBox, start: Array, step: float) -> Array:
    """The plant (1, p) of a rough simulator that is nearest to the recording."""
    theta = np.clip(
        identify_from_several(rough, model.u, model.y, start).theta, *_inside(rough, step)
    )
    theta[:, rough.known] = start[:, rough.known]
    return theta


def _inside(plant: Plant, step: float) -> tuple[Array, Array]:
    """The search limits without what steps to either side would leave."""
    low, high = plant.limits
    room = np.zeros(len(low))
    room[plant.unknown] = step * plant.width
    return low + room, high - room


@dataclass(frozen=True, slots=True, eq=False)
class LocalEmulator:
    """Outputs of second degree in each unknown parameter, for one input.

    Attributes
    ----------
    centre : NDArray
        (p,) parameters around which outputs were simulated.
    unknown, width : NDArray
        (q,) indices of the unknown parameters, and their ranges' widths.
    u : NDArray
        (1, N) the input.
    y, slopes, bends : NDArray
        (N,) output at the centre, and (q, N) first and half the second derivatives in widths.
    """

    centre: Array
    unknown: NDArray[np.intp]
    width: Array
    u: Array
    y: Array
    slopes: Array
    bends: Array
    batched: bool = field(default=True, init=False)

    @classmethod
    def of(cls, plant: Plant, theta: Array, u: Array, step: float) -> "LocalEmulator":
        """Around one plant (1, p), from simulations `step` of a range to either side."""
        unknown, width = plant.unknown, plant.width
        offsets = np.zeros((len(unknown), theta.shape[1]))
        offsets[np.arange(len(unknown)), unknown] = step * width
        y, above, below = np.split(
            plant.respond(np.concatenate([theta, theta + offsets, theta - offsets]), u),
            [1, 1 + len(unknown)],
        )
        slopes, bends = (above - below) / (2 * step), (above + below - 2 * y) / (2 * step**2)
        return cls(theta[0], unknown, width, u, y[0], slopes, bends)

    def __call__(self, theta: Array, u: Array, rng: Any = None) -> Array:
        """Outputs (B, N) of plants (B, p)."""
        away = (theta - self.centre)[:, self.unknown] / self.width
        return np.asarray(self.y + away @ self.slopes + away**2 @ self.bends)

    def moved(self, theta: Array, y: Array) -> "LocalEmulator":
        """Around a plant (p,) whose output (N,) is known; what it errs there is slopes' error."""
        away = (theta - self.centre)[self.unknown] / self.width
        slopes, distance = self.slopes + 2 * away[:, None] * self.bends, away @ away
        if distance > _SAME**2:
            error = y - self(theta[None], self.u)[0]
            slopes = slopes + away[:, None] * error / distance
        return replace(self, centre=theta, y=y, slopes=slopes)

    def knows(self, u: Array) -> bool:
        """Whether it is the recording's input."""
        return u.shape == self.u.shape and bool((u == self.u).all())

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Nothing is saved: it belongs to one recording."""
        return {}


@dataclass(frozen=True, slots=True, eq=False)
class _LinearAnswers:
    """A plant's emulated answer to its experiment as a linear model, for any input."""

    plant: Plant
    functions: Laguerre
    Ts: float
    batched: bool = field(default=True, init=False)

    def __call__(self, theta: Array, u: Array, rng: Any = None) -> Array:
        """Outputs (B, N) of plants (B, p) for an input (N,)."""
        own = self.plant.u
        y = self.plant.emulated(own).respond(theta, own)
        known, asked = self._signals(own, self.plant.Ts), self._signals(u, self.Ts)
        return np.asarray(np.linalg.lstsq(known.T, y.T, rcond=_KNOWN)[0].T @ asked)

    def _signals(self, u: Array, Ts: float) -> Array:
        """Filtered inputs, and the same of a constant: in the mean, squares of inputs are one."""
        both = np.stack([np.ravel(u), np.ones(u.size)])
        return self.functions.regressors(both, Ts).reshape(-1, u.size)


class _Cache:
    """A simulator that is not asked twice for the same plant and input."""

    batched = True

    def __init__(self, plant: Plant) -> None:
        self._plant, self._known = plant, dict[bytes, Array]()

    def __call__(self, theta: Array, u: Array, rng: Any = None) -> Array:
        """Outputs (B, N) of plants (B, p) for an input (N,)."""
        keys = [row.tobytes() + u.tobytes() for row in theta]
        rows = [i for i, key in enumerate(keys) if key not in self._known]
        if rows:
            answers = self._plant.respond(theta[rows], u)
            self._known.update(zip((keys[i] for i in rows), answers, strict=True))
        return np.stack([self._known[key] for key in keys])
