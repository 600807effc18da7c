"""The plants that the method's tests run on, with small tuners and test episodes for each."""

from functools import cache

import numpy as np
from first_order import linear, weighed
from recordings import ROOT

import tuners
from tuners.learners.feedforward import FeedForwardSettings
from tuners.tuner.recipes import features_for
from tuners.tuner.recording import Recording
from tuners.tuner.stages import Recipe
from tuners.tuner.tuner import Tuner
from yawrate_env.plant import episodes
from yawrate_env.plant.entry import find
from yawrate_env.plant.plant import Plant
from yawrate_env.vehicle.nonlinear import NonlinearTwin
from yawrate_env.vehicle.task import Experiment, Prior, Task
from yawrate_env.vehicle.yaw_rate import yaw_rate

SHORT = Experiment(Ts=0.01, N=1000)
STRONG = Experiment(Ts=0.01, N=300, amplitude=float(np.radians(4.0)))
VEHICLE = Task(experiment=SHORT)

FAMILIES: dict[str, Plant] = {
    "lag": linear,
    "lag of measured gain": weighed,
    "vehicle": yaw_rate(VEHICLE),
    "vehicle of any speed": yaw_rate(Task(experiment=SHORT, prior=Prior(v_x=(10.0, 33.0)))),
    "nonlinear vehicle": yaw_rate(Task(experiment=STRONG, twin=NonlinearTwin())),
    "motor": find("dc_motor:plant", ROOT / "examples" / "plants"),
}

SLOW = "nonlinear vehicle", "motor"
LINEAR = [name for name, plant in FAMILIES.items() if plant.linear]
COUNT = 24


@cache
def trained(name: str) -> Tuner:
    """A tuner of a few seconds, with calibrated intervals."""
    plant = FAMILIES[name]
    learner = FeedForwardSettings(neurons=8, epochs=80, max_fail=10)
    recipe = Recipe(features_for(plant), learner, noise_draws=2, episodes=250)
    return tuners.train(recipe, plant, calibration=64 if name in SLOW else 256)


@cache
def reference(name: str, method: type) -> Tuner:
    """A tuner that needs no training."""
    return Tuner(FAMILIES[name], method(), {"name": method.kind})


@cache
def tested(name: str, count: int = COUNT) -> Recording:
    """The first recordings of the test set, with the truth; read-only."""
    plant = FAMILIES[name]
    found = episodes.recorded(plant, "test", 0, count)
    for array in (found.u, found.y, found.theta):
        array.setflags(write=False)
    return Recording(found.u, found.y, plant.Ts, found.theta)


def observed(plant: Plant, recording: Recording) -> np.ndarray:
    """What the plant's environment shows of recordings: input, output, measured parameters."""
    u = np.broadcast_to(recording.u, recording.y.shape)
    known = recording.known[:, plant.indices(plant.measured_names)]
    rows = [np.broadcast_to(column[:, None], u.shape) for column in known.T]
    return np.stack([u, recording.y, *rows], axis=1)


def one(plant: Plant, recording: Recording, index: int) -> dict:
    """Arguments of `Tuner.tune` for one of the recordings."""
    measured = {
        name: recording.known[index, plant.indices((name,))[0]] for name in plant.measured_names
    }
    u = recording.u[min(index, len(recording.u) - 1)]
    return {"u": u, "y": recording.y[index], "Ts": recording.Ts, "measured": measured}
