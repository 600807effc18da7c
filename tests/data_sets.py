"""Small data sets: of the first-order plant, of one with every extra, and of vehicles."""

import os
import sys
from contextlib import contextmanager

import numpy as np
import pytest
from first_order import described, design, plant, simulate

from tuners.data import DatasetError, generate
from tuners.features.laguerre import Laguerre
from tuners.features.response import FrequencyResponse
from yawrate_env.loop.target import Target
from yawrate_env.plant.noise import snr
from yawrate_env.plant.parametrisation import Parametrisation
from yawrate_env.signals.excitation import prbs
from yawrate_env.vehicle.task import Experiment, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

STAGE = Laguerre(4, 2.0)
OTHER = FrequencyResponse(8, 2.0, 0.05, 2.0)
EPISODES, SHARD = 200, 50


def wandering(theta, u, rng):
    """A lag whose level is random in the plant itself; only recordings have it."""
    y = simulate(theta, u, None)
    return y if rng is None else y + 0.1 * rng.standard_normal((len(theta), 1))


def for_some(theta):
    """Gains of both signs, for plants that are not too slow."""
    return np.where(theta[:, 1:] < 0.9, [1.0, -1.0] * design(theta), np.nan)


rich = described(
    simulate=wandering,
    design=for_some,
    measured={"K": 0.1},
    excite=lambda integers: prbs(500, 0.02, 0.5, 1.0, order=7, start=integers),
    parametrisation=Parametrisation(lambda gains: gains, lambda values: values),
    noise=snr(20.0),
    entry="data_sets:rich",
)

# Short episodes, and a target that some of the vehicles cannot reach.
TASK = Task(experiment=Experiment(Ts=0.01, N=1000), target=Target(55.0, 2.0))
cars = yaw_rate(TASK)


def made(out, episodes=EPISODES, *, of=plant, set="train", stage=STAGE, count=1, **kwargs):
    kwargs = {"shard_size": SHARD, "workers": count} | kwargs
    return generate(of, set, stage, episodes, 3, out, **kwargs)


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def damage(path):
    """Alter one byte in the middle of a file."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def environment():
    """Variables with which another process finds these modules."""
    paths = [os.path.dirname(__file__), os.getcwd(), *sys.path]
    return os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}


@contextmanager
def refused(folder, match):
    """A refusal that leaves every file as it was."""
    before = contents(folder)
    with pytest.raises(DatasetError, match=match):
        yield
    assert contents(folder) == before
