"""Episodes of a plant's sets as the studies need them: drawn, recorded and assessed."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tuners.trust.checks import Assessment
from tuners.tuner.recording import Recording
from tuners.tuner.tuner import Tuner
from yawrate_env.plant.episodes import SETS, Draw, Episodes, episodes, integers_of, ranges_of
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.streams import stream
from yawrate_env.vehicle.task import Task

Array = NDArray[np.float64]


def draw(plant: Plant, name: str, seed: int, first: int, count: int) -> Draw:
    """Episodes ``first`` to ``first + count`` of a set, before they are simulated."""
    integers = stream((SETS[name], seed), first, count, integers_of(plant))
    return Draw.of(plant, integers, ranges_of(plant, name))


def recording(plant: Plant, theta: Array, u: Array, y: Array) -> Recording:
    """Recordings with their measured parameters, which `theta` (B, p) has among others."""
    known = np.full_like(theta, np.nan)
    measured = plant.indices(plant.measured)
    known[:, measured] = theta[:, measured]
    return Recording(u, y, plant.Ts, known)


def recorded(plant: Plant, drawn: Draw) -> Recording:
    """Simulate drawn episodes."""
    return recording(plant, drawn.theta, drawn.u, plant.measure(drawn.theta, drawn.u, drawn.keys))


def assessed(
    tuner: Tuner, plant: Plant, name: str, seed: int, count: int
) -> Iterator[tuple[Episodes, Assessment, Array]]:
    """Tune and assess the first episodes of a set, block by block.

    Yields
    ------
    Episodes
    Assessment
    (B, f) float64
        Metrics with the true plants; ``nan`` if unstable.
    """
    for block in episodes(plant, name, seed, 0, count):
        gains, found = tuner.assess(recording(plant, block.theta, block.u, block.y))
        yield block, found, plant.metric_values(block.theta, gains.values)


def task_of(plant: Plant) -> Task:
    """The task that a vehicle's plant was made from."""
    return Task.of(dict(plant.arguments))
