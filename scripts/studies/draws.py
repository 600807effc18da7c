"""Episodes of a plant's sets as the studies need them: drawn, then recorded."""

import numpy as np
from numpy.typing import NDArray

from tuners.tuner.recording import Recording
from yawrate_env.plant.episodes import SETS, Draw, integers_of, ranges_of
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.streams import stream
from yawrate_env.vehicle.task import Task

Array = NDArray[np.float64]


def draw(plant: Plant, name: str, seed: int, first: int, count: int) -> Draw:
    """Episodes ``first`` to ``first + count`` of a set, before they are simulated."""
    integers = stream((SETS[name], seed), first, count, integers_of(plant))
    return Draw.of(plant, integers, ranges_of(plant, name))


def recorded(plant: Plant, drawn: Draw) -> Recording:
    """Simulate drawn episodes; tuners find the measured parameters among the known ones."""
    y = plant.measure(drawn.theta, drawn.u, drawn.keys)
    return Recording(drawn.u, y, plant.Ts, drawn.theta)


def task_of(plant: Plant) -> Task:
    """The task that a vehicle's plant was made from."""
    return Task.of(dict(plant.arguments))
