"""Tuners of every kind that can be exported, hardly trained: answers are to be equal, not good."""

import sys
from dataclasses import dataclass
from functools import cache

import numpy as np
from first_order import TS, described, simulate
from recordings import ROOT

import tuners
from tuners.features.laguerre import Laguerre
from tuners.features.response import FrequencyResponse
from tuners.learners.actor import Actor, Agent
from tuners.learners.feedforward import FeedForward, FeedForwardSettings, _Scaling
from tuners.learners.gbm import GBMSettings
from tuners.learners.polynomial import PolynomialSettings
from tuners.learners.trend import TrendSettings
from tuners.trust.basis import suited_to_any_input
from tuners.tuner.stages import Stages, coordinates_of
from yawrate_env.plant.episodes import recorded
from yawrate_env.signals.excitation import RANDOM_ORDER, prbs

sys.path.append(str(ROOT / "examples" / "plants"))
import dc_motor  # noqa: E402

SMALL = FeedForwardSettings(neurons=6, epochs=8)
LAGUERRE, TREES = Laguerre(8, 2.0), GBMSettings(n_estimators=20)
MOTOR = Laguerre(6, 40.0)


def registers(integers):
    """A random register for each integer."""
    return prbs(500, TS, 0.5, 1.0, order=RANDOM_ORDER, start=integers)


def drifting(theta, u, rng):
    """The first-order plant on a slope."""
    return simulate(theta[:, :2], u, rng) + theta[:, 2:] * np.arange(u.shape[-1]) * TS


def three(theta):
    """Gains of a controller with three."""
    K, T, slope = theta.T
    return np.stack([T / K, T, 2 + slope], axis=1)


SLOPED = described(
    prior={"K": (0.5, 2.0), "T": (0.2, 1.0), "slope": (-0.1, 0.1)}, simulate=drifting,
    design=three, gains=("Kc", "Ti", "Td"), measured={"slope": 0.0, "T": 0.1}, signals=("u", "y"),
)  # fmt: skip
VARIOUS = described(excite=registers)
PRIOR = suited_to_any_input(VARIOUS, 24)
RESPONSE = FrequencyResponse(order=8, pole=40.0, low=2.0, high=30.0, points=5)


@dataclass(frozen=True)
class Untrained:
    """Agents that learned nothing."""

    hidden: str
    squashed: bool

    def fit(self, training, validation, random_state, progress=None):
        ((X, T),) = training
        widths, rng = (X.shape[1], 7, 7, T.shape[1]), np.random.default_rng(random_state)
        pairs = zip(widths[1:], widths, strict=False)
        layers = [(rng.normal(size=(a, b)) / 2, rng.normal(size=a) / 2) for a, b in pairs]
        actor = Actor(layers, self.hidden, self.squashed)
        return Agent(actor, X.mean(axis=0), X.std(axis=0), T.min(axis=0), T.max(axis=0))


CASES = {
    "logarithms": (described(), LAGUERRE, SMALL),
    "measured": (SLOPED, LAGUERRE, TrendSettings(SMALL, degree=2)),
    "gains of a loop": (dc_motor.plant, MOTOR, SMALL, "gains"),
    "loop": (dc_motor.plant, MOTOR, TrendSettings(SMALL)),
    "frequency response": (dc_motor.plant, RESPONSE, SMALL),
    "cubic": (described(), LAGUERRE, PolynomialSettings(degree=3)),
    "trees": (SLOPED, LAGUERRE, TrendSettings(TREES)),
    "agent": (SLOPED, LAGUERRE, Untrained("relu", True)),
    "agent, clipped": (dc_motor.plant, MOTOR, Untrained("tanh", False)),
    "regularised": (described(), PRIOR, SMALL),
    "inputs": (VARIOUS, LAGUERRE, SMALL),
    "regularised inputs": (VARIOUS, PRIOR, TrendSettings(SMALL)),
}
OWN_INPUTS = [name for name, (plant, *_) in CASES.items() if plant.excite]
SINGLE = "trees", "agent", "agent, clipped"
"""In single precision."""
NETWORKS = [name for name in CASES if name not in (*SINGLE, "cubic")]


def hardly_trained(plant, features, learner, parametrisation="plant"):
    recipe = tuners.Recipe(features, learner, parametrisation, noise_draws=2)
    return tuners.train(recipe, plant, episodes=60, calibration=0)


@cache
def trained(case):
    return hardly_trained(*CASES[case])


@cache
def faulty(case):
    """Recordings of a case's plant, some of which no plant gives."""
    plant = trained(case).plant
    found = recorded(plant, "test", 0, 60)
    y = found.y.copy()
    y[1] = 0.0
    y[2] *= 1e7
    y[3, 50], y[4, -1] = np.nan, np.inf
    u = found.u.copy()
    if len(u) > 1:
        u[5] = 0.0
    theta = found.theta.copy()
    theta[6, plant.indices(plant.measured_names)] = np.nan
    return u, y, theta


def expected(tuner, u, y, theta):
    """Gains (B, k) and status (B,) of recordings by the tuner's stages."""
    plant, stages = tuner.plant, tuner.method
    values, usable = stages.predict(u, y, plant.Ts, plant.measured_features(theta))
    gains = coordinates_of(plant, stages.parametrisation).decode(values)
    return np.where(usable[:, None], gains, np.nan)


def measured(plant, theta):
    """Measured parameters by name, (B,) each."""
    columns = plant.indices(plant.measured_names)
    return dict(zip(plant.measured_names, theta[:, columns].T, strict=True))


def echo(n):
    """A network whose hidden layer is so small that it is linear: it gives back its input."""
    scaling = [_Scaling(np.zeros(k), np.ones(k)) for k in (n, 2)]
    return FeedForward(1e-9 * np.eye(2, n), np.zeros(2), 1e9 * np.eye(2), np.zeros(2), *scaling)


def echoing(plant, features=2, parametrisation="plant"):
    """A tuner whose learner gives back its features."""
    stages = Stages(Laguerre(order=2), echo(features), parametrisation)
    return tuners.Tuner(plant, stages)


def one(tuner):
    """The first test episode's result."""
    found = recorded(tuner.plant, "test", 0, 1)
    values = {name: row[0] for name, row in measured(tuner.plant, found.theta).items()}
    return tuner.tune(found.u[0], found.y[0], measured=values)
