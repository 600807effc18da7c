"""Random episodes of a plant, the same whatever batch they are asked for in.

Parameters, input and measurement noise come from integers of an episode's own.  A generator
for what is random inside the simulator belongs to a block of episodes, and blocks are
computed whole, whatever part of them is asked for: BLAS sums in another order when a batch
is of another size, and the last bits of a row would depend on where a data set was cut.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from yawrate_env import validation
from yawrate_env.batch import concatenate
from yawrate_env.plant.calls import call
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.noise import KEY_WORDS
from yawrate_env.signals.streams import stream, uniform

Array = NDArray[np.float64]
Integers = NDArray[np.uint64]
Progress = Callable[[int, int], None]

BLOCK = 128

SETS = {"train": 1, "test": 2, "extrapolation": 3, "calibration": 4}
"""Names of sets of episodes that never share one, whatever the seeds; the tags keep their
random streams apart."""

_SEED = 20
_TRIED = 256


@dataclass(frozen=True, slots=True, eq=False)
class Draw:
    """B random experiments, before they are simulated.

    Attributes
    ----------
    theta : NDArray
        (B, p) parameters.
    u : NDArray
        (1, N) or (B, N) inputs.
    keys : NDArray
        (B, 4) noise streams.
    """

    theta: Array
    u: Array
    keys: Integers

    @classmethod
    def of(
        cls, plant: Plant, integers: Integers, ranges: tuple[Array, Array] | None = None
    ) -> "Draw":
        """Turn random integers (B, `integers_of`) into experiments of the prior.

        Parameters
        ----------
        ranges : tuple of NDArray, optional
            Low and high ends of the parameters, (p,) each, if not the prior's.
        """
        p = len(plant.prior)
        return cls(
            parameters(plant, integers[:, :p], ranges),
            plant.inputs(integers[:, p]),
            np.ascontiguousarray(integers[:, p + 1 :]),  # compiled for once
        )


@dataclass(frozen=True, slots=True, eq=False)
class Episodes:
    """B recorded experiments.

    Attributes
    ----------
    number : NDArray
        (B,) which episodes of their seed.
    theta : NDArray
        (B, p) the truth.
    u : NDArray
        (1, N) or (B, N) inputs.
    y : NDArray
        (B, N) measured outputs.
    """

    number: NDArray[np.int64]
    theta: Array
    u: Array
    y: Array

    def __len__(self) -> int:
        return len(self.y)


def integers_of(plant: Plant) -> int:
    """How many 64-bit integers an episode takes: parameters, input, and the noise's key."""
    return len(plant.prior) + 1 + KEY_WORDS


def parameters(
    plant: Plant, integers: Integers, ranges: tuple[Array, Array] | None = None
) -> Array:
    """Random integers (B, p) to parameters (B, p) of the prior, or uniform where ranges differ."""
    prior = plant.ranges
    low, high = prior if ranges is None else ranges
    unit = uniform(integers)
    theta = np.asarray(low + (high - low) * unit)
    if plant.together is not None and np.array_equal((low, high), prior):
        return _together(plant, plant.together, unit)
    for i, each in enumerate(plant.shapes):
        if (low[i], high[i]) == (prior[0][i], prior[1][i]):
            theta[:, i] = each.at(unit[:, i])
    return theta


def _together(plant: Plant, together: Callable[[Array], Array], unit: Array) -> Array:
    """Parameters (B, p) that are not independent, which the plant makes of uniform numbers."""
    low, high = plant.ranges
    theta = call("together", together, unit.copy())
    theta = validation.finite_array("together's answer", theta, shape=unit.shape)
    outside = np.argwhere((theta < low) | (theta > high))
    if len(outside):
        row, i = outside[0]
        raise ValueError(
            f"together's answer has {list(plant.prior)[i]} = {theta[row, i]:g}, outside the "
            f"prior's [{low[i]:g}, {high[i]:g}]. Widen that range, or cut the answer off."
        )
    return theta


def prior_gains(plant: Plant) -> Array:
    """Gains (m, k) of 256 plants of the prior, those that have any; ``ValueError`` if none has."""
    gains, reached = plant.designs(sample(plant, _TRIED))
    found = gains[reached]
    if not len(found):
        raise ValueError(
            f"design gives no gains for any of {_TRIED} plants of the prior: nothing can be "
            "learned. Choose a target that can be reached, or another prior."
        )
    return found


def share_without_gains(plant: Plant) -> float:
    """Share of the prior's plants for which the design rule has no gains that reach its target."""
    return 1 - len(prior_gains(plant)) / _TRIED


def sample(plant: Plant, count: int) -> Array:
    """(count, p) parameters of the prior that belong to no data set, always the same."""
    return parameters(plant, stream(_SEED, 0, count, len(plant.prior)))


def episodes(
    plant: Plant, name: str, seed: int, first: int, count: int, repeat: int = 0
) -> Iterator[Episodes]:
    """Episodes ``first`` to ``first + count`` of a seed, block by block.

    Parameters
    ----------
    name : str
        Which of the sets that never share an episode (`SETS`).
    repeat : int
        Another one has the same parameters and inputs, and fresh noise.
    """
    for block, asked in blocks(plant, name, seed, first, count, repeat):
        yield part(block, asked)


def recorded(
    plant: Plant, name: str, seed: int, count: int, repeat: int = 0, *, first: int = 0
) -> Episodes:
    """`count` episodes of a seed in one piece."""
    parts = list(episodes(plant, name, seed, first, count, repeat))
    whole = concatenate(parts)
    return whole if len(whole.u) == len(whole) else replace(whole, u=parts[0].u)


def ranges_of(plant: Plant, name: str) -> tuple[Array, Array]:
    """Low and high ends (p,) of the parameters in a set: the prior's, but in ``extrapolation``."""
    low, high = plant.ranges
    if name != "extrapolation":
        return low, high
    if not plant.extrapolation:
        raise ValueError(
            "set of episodes = 'extrapolation': this plant names no ranges outside its prior. "
            "Give Plant(extrapolation={name: (low, high)}), or use another set."
        )
    for i, (a, b) in zip(
        plant.indices(plant.extrapolation), plant.extrapolation.values(), strict=True
    ):
        low[i], high[i] = a, b
    return low, high


def blocks(
    plant: Plant, name: str, seed: int, first: int, count: int, repeat: int
) -> Iterator[tuple[Episodes, slice]]:
    """Whole blocks, and which of their rows are asked for."""
    tag, stop = SETS[validation.one_of("set of episodes", name, tuple(SETS))], first + count
    ranges = ranges_of(plant, name)
    for start in range(first - first % BLOCK, stop, BLOCK):
        root = (tag, seed, repeat) if repeat else (tag, seed)
        draw = _draw(plant, tag, seed, start, repeat, ranges)
        rng = np.random.default_rng(np.random.SeedSequence(root, spawn_key=(start, 1)))
        y = plant.measure(draw.theta, draw.u, draw.keys, rng)
        number = np.arange(start, start + BLOCK)
        yield Episodes(number, draw.theta, draw.u, y), slice(max(first - start, 0), stop - start)


def _draw(
    plant: Plant, tag: int, seed: int, start: int, repeat: int, ranges: tuple[Array, Array]
) -> Draw:
    """One block's experiments."""
    integers = stream((tag, seed), start, BLOCK, integers_of(plant))
    if repeat:
        fresh = stream((tag, seed, repeat), start, BLOCK, integers_of(plant))
        integers[:, -KEY_WORDS:] = fresh[:, -KEY_WORDS:]
    return Draw.of(plant, integers, ranges)


def drawn(plant: Plant, name: str, seed: int, count: int) -> Array:
    """Parameters (count, p) of the first episodes of a set, which are not simulated."""
    tag, ranges = SETS[validation.one_of("set of episodes", name, tuple(SETS))], plant.ranges
    if not count:
        return np.empty((0, len(plant.prior)))
    blocks = (_draw(plant, tag, seed, start, 0, ranges) for start in range(0, count, BLOCK))
    return np.concatenate([block.theta for block in blocks])[:count]


def part(block: Episodes, asked: slice) -> Episodes:
    """Some of the episodes."""
    u = block.u if len(block.u) == 1 else block.u[asked]
    return Episodes(block.number[asked], block.theta[asked], u, block.y[asked])
