"""The yaw-rate case: a `Task`'s vehicles as a plant like any other.

Every tuner for vehicles gets its data, its training, its trust and its intervals from
`tuners.plants` by this description; what it adds are the vehicle's own names and units.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners import identification
from tuners.compressors.laguerre import Laguerre
from tuners.plants.coordinates import PLAIN, Coordinates, loop
from tuners.plants.figure import Figure
from tuners.plants.identification import identify
from tuners.plants.pi_loop import GAINS, PILoop
from tuners.plants.plant import Plant, Search, snr
from tuners.recording import Recording
from yawrate_env.compiled import LANES, over_blocks
from yawrate_env.design import Status
from yawrate_env.discretisation import DiscretePlant
from yawrate_env.episode import excitation, plants, respond
from yawrate_env.judge import Judge
from yawrate_env.reward import CROSSOVER_SCALE, PHASE_SCALE
from yawrate_env.task import Target, Task
from yawrate_env.twin import LinearTwin
from yawrate_env.vehicle import Context

Array = NDArray[np.float64]
Words = NDArray[np.uint64]

SPEED_SLACK = 0.25
"""How far outside the prior a recording's speed may lie [m/s]."""

BLACK_BOX = Laguerre(order=20, pole=12.0)
"""Explains vehicles from 10 to 33 m/s to -45 dB or better, at 20 m/s to -80 dB."""

FIGURES = {
    "phase margin [deg]": Figure(PHASE_SCALE, error=1.5, spread=0.5),
    "crossover [Hz]": Figure(CROSSOVER_SCALE, error=0.075, spread=0.025),
}

COORDINATES: dict[str, Callable[[Target], Coordinates]] = {
    "loop": loop,
    "gains": lambda target: PLAIN,
}

_FRICTION, _MASS = (1e-3, 1e2), (1.0, 1e6)  # bounds that no vehicle reaches


def context_of(theta: Array) -> Context:
    """Parameters (B, 3) as vehicles."""
    return Context(*theta.T.copy())


def theta_of(context: Context) -> Array:
    """Vehicles as parameters (B, 3)."""
    return np.stack([context.mu_s, context.M_delta, context.v_x], axis=1)


@lru_cache(maxsize=32)
def yaw_rate(task: Task, coordinates: str = "loop") -> Plant:
    """Describe a task's vehicles, experiment and loop target.

    Friction and extra mass are unknown, but where the prior is a point; the speed is
    measured with every recording.  The simulator is the task's twin, judged in its
    linearisation.

    Parameters
    ----------
    coordinates : {"loop", "gains"}
        What a learner predicts (`tuners.coordinates`).
    """
    experiment, prior = task.experiment, task.prior

    def simulate(theta: Array, u: Array, rng: Any) -> Array:
        y, inputs = np.empty((len(theta), u.shape[-1])), np.atleast_2d(u)
        into = task.twin.simulator(task.vehicle, context_of(theta), inputs, experiment.Ts)

        def work(i: int, j: int) -> None:
            into(y[i:j], i, j)

        over_blocks(work, len(theta), LANES)
        return y

    def record(theta: Array, u: Array, keys: Words) -> Array:
        return np.asarray(respond(task, context_of(theta), u, keys), dtype=np.float64)

    def discrete(theta: Array, Ts: float) -> DiscretePlant:
        return plants(task.vehicle, context_of(theta), Ts)

    def design(theta: Array) -> Array:
        found = Judge.of(task, context_of(theta)).oracle()
        gains = np.stack([found.kp, found.Ti], axis=1)
        return np.where(found.status[:, None] == Status.OK, gains, np.nan)

    linear = isinstance(task.twin, LinearTwin)
    plant = Plant(
        prior={"mu_s": prior.mu_s, "M_delta": prior.M_delta, "v_x": prior.v_x},
        measured={"v_x": SPEED_SLACK},
        simulate=simulate,
        design=design,
        judge=PILoop(discrete, experiment.Ts, task.target).judge,
        gains=GAINS,
        figures=FIGURES,
        target=(task.target.phase_margin, task.target.crossover),
        coordinates=COORDINATES[coordinates](task.target),
        u=excitation(experiment, np.zeros(1, np.uint64))[0],
        excite=None
        if experiment.register == "same"
        else lambda words: excitation(experiment, words),
        Ts=experiment.Ts,
        noise=snr(experiment.snr_db),
        linear=linear,
        crossover=task.target.crossover,
        signals=("steering command [rad]", "yaw rate [rad/s]"),
        record=record,
        search_limits=_limits(task, linear),
        black_box=BLACK_BOX,
    )
    compiled = _gray_box(task)
    return replace(plant, gray_box=compiled if linear else _refined(plant, compiled))


def _gray_box(task: Task) -> Search:
    """The compiled search with exact sensitivities."""
    friction, mass = (low < high for low, high in (task.prior.mu_s, task.prior.M_delta))

    def search(u: Array, y: Array, theta: Array) -> tuple[Array, NDArray[np.bool_]]:
        recording = Recording(u, y, task.experiment.Ts)
        start, speeds = context_of(theta[:1]), theta[:, 2]
        found = identification.identify(task.vehicle, recording, start, speeds, (friction, mass))
        return theta_of(found.context), found.converged

    return search


def _refined(plant: Plant, rough: Search) -> Search:
    """A search by differences that starts from where another one ends."""

    def search(u: Array, y: Array, theta: Array) -> tuple[Array, NDArray[np.bool_]]:
        start = np.clip(rough(u, y, theta)[0], *plant.limits)
        start[:, plant.known] = theta[:, plant.known]
        found = identify(plant, u, y, start, beyond=True)
        return found.theta, found.converged

    return search


def _limits(task: Task, linear: bool) -> dict[str, tuple[float, float]]:
    """How far the searches go: a vehicle may be lighter than the lightest of the prior.

    The compiled one goes anywhere that foreign recordings send it.
    """
    lightest, heaviest = (mass - task.vehicle.M_0 for mass in _MASS)
    if linear:
        limits = {"mu_s": _FRICTION, "M_delta": (lightest, heaviest)}
    else:
        low, high = task.prior.M_delta
        spare = (high - low) / 2
        limits = {"M_delta": (max(low - spare, lightest), high + spare)}
    priors = {name: getattr(task.prior, name) for name in limits}
    return {
        name: (min(low, priors[name][0]), max(high, priors[name][1]))
        for name, (low, high) in limits.items()
    }
