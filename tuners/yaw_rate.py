"""The yaw-rate case: a `Task`'s vehicles as a plant like any other.

Every tuner for vehicles gets its data, its training, its trust and its intervals from
`tuners.plants` by this description; what it adds are the vehicle's own names and units.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.features.laguerre import Laguerre
from tuners.trust import vehicle_identification as identification
from tuners.trust.identification import identify
from tuners.tuner.recording import Recording
from yawrate_env.compiled import LANES, over_blocks
from yawrate_env.loop.design import Status, required_response
from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.target import Target
from yawrate_env.plant.metric import Figure
from yawrate_env.plant.parametrisation import PLAIN, Coordinates, loop
from yawrate_env.plant.pi_loop import GAINS, PILoop
from yawrate_env.plant.plant import Plant, Range, Search, snr
from yawrate_env.plant.responses import ClosedLoop
from yawrate_env.plant.reward import CROSSOVER_SCALE, PHASE_SCALE
from yawrate_env.vehicle.episode import excitation, plants, respond
from yawrate_env.vehicle.judge import Judge
from yawrate_env.vehicle.plausible import LARGEST_ANGLE, LARGEST_YAW_RATE
from yawrate_env.vehicle.single_track import LARGEST, Context
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.twin import LinearTwin

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


IN_DEGREES = "steering [deg]", "yaw rate [deg/s]"
"""What pictures show."""

COORDINATES: dict[str, Callable[[Target], Coordinates]] = {
    "loop": loop,
    "gains": lambda target: PLAIN,
}

_FRICTION, _MASS = (1e-3, 1e2), (1.0, 1e6)  # bounds that no vehicle reaches
_SLOWEST = 0.1  # m/s: at rest the single-track vehicle has no steady answer


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
        What a learner predicts (`tuners.tuner.coordinates`).
    """
    experiment, prior, vehicles = task.experiment, task.prior, Vehicles(task)
    plant = Plant(
        prior={"mu_s": prior.mu_s, "M_delta": prior.M_delta, "v_x": prior.v_x},
        measured={"v_x": SPEED_SLACK},
        simulate=vehicles.simulate,
        design=vehicles.design,
        judge=vehicles.judge,
        gains=GAINS,
        figures=FIGURES,
        target=(task.target.phase_margin, task.target.crossover),
        coordinates=COORDINATES[coordinates](task.target),
        u=excitation(experiment, np.zeros(1, np.uint64))[0],
        excite=vehicles.excite if experiment.register == "random" else None,
        Ts=experiment.Ts,
        noise=snr(experiment.snr_db),
        linear=vehicles.linear,
        crossover=task.target.crossover,
        plausible=(LARGEST_ANGLE, LARGEST_YAW_RATE),
        signals=("steering command [rad]", "yaw rate [rad/s]"),
        record=vehicles.record,
        search_limits=vehicles.limits(),
        reach=vehicles.reach if coordinates == "loop" else None,
        loop=vehicles.loop,
        black_box=BLACK_BOX,
    )
    search = vehicles.search if vehicles.linear else Refined(plant, vehicles.search)
    return replace(plant, gray_box=search)


@dataclass(frozen=True, slots=True)
class Vehicles:
    """What a plant's description asks of a task's vehicles: parameters (mu_s, M_delta, v_x)."""

    task: Task

    @property
    def linear(self) -> bool:
        """Whether the twin is."""
        return isinstance(self.task.twin, LinearTwin)

    def simulate(self, theta: Array, u: Array, rng: Any) -> Array:
        """Noise-free yaw rates (B, N) from rest; nothing in a twin is random."""
        task, inputs = self.task, np.atleast_2d(u)
        y = np.empty((len(theta), inputs.shape[1]))
        into = task.twin.simulator(task.vehicle, context_of(theta), inputs, task.experiment.Ts)

        def work(i: int, j: int) -> None:
            into(y[i:j], i, j)

        over_blocks(work, len(theta), LANES)
        return y

    def record(self, theta: Array, u: Array, keys: Words) -> Array:
        """Measured yaw rates, as the environment has them."""
        return np.asarray(respond(self.task, context_of(theta), u, keys), dtype=np.float64)

    def excite(self, words: Words) -> Array:
        """A random register each."""
        return excitation(self.task.experiment, words)

    def design(self, theta: Array) -> Array:
        """Gains (B, 2) that give the target; ``nan`` where a PI misses it."""
        found = Judge.of(self.task, context_of(theta)).oracle()
        gains = np.stack([found.kp, found.Ti], axis=1)
        return np.where(found.status[:, None] == Status.OK, gains, np.nan)

    def judge(self, theta: Array, gains: Array) -> Array:
        """Phase margin [deg] and crossover [Hz], (B, 2)."""
        return self._pi().judge(theta, gains)

    def loop(self, theta: Array, gains: Array) -> ClosedLoop:
        """One vehicle's, for small steps: in degrees, as people read them."""
        return self._pi(IN_DEGREES).around(theta, gains)

    def _pi(self, signals: tuple[str, str] = ("", "")) -> PILoop:
        return PILoop(self.discrete, self.task.experiment.Ts, self.task.target, signals)

    def discrete(self, theta: Array, Ts: float) -> DiscretePlant:
        """The linear vehicles at a sampling time [s]."""
        return plants(self.task.vehicle, context_of(theta), Ts)

    def search(self, u: Array, y: Array, theta: Array) -> tuple[Array, NDArray[np.bool_]]:
        """The linear vehicle behind recordings, by exact sensitivities, compiled."""
        task = self.task
        friction, mass = (low < high for low, high in (task.prior.mu_s, task.prior.M_delta))
        recording = Recording(u, y, task.experiment.Ts)
        start, speeds = context_of(theta[:1]), theta[:, 2]
        found = identification.identify(task.vehicle, recording, start, speeds, (friction, mass))
        return theta_of(found.context), found.converged

    def reach(self) -> tuple[Array, Array]:
        """Log magnitudes and phases [rad] of the controller at the crossover, for agents.

        The magnitudes that vehicles of the prior need and half an octave more; most of the
        phases that a PI has, or nearly all of them where the prior needs them.
        """
        prior = self.task.prior
        grid = np.meshgrid(
            *(np.linspace(*ends, 3) for ends in (prior.mu_s, prior.M_delta, prior.v_x))
        )
        context = Context.of(*(axis.ravel() for axis in grid))
        judge = Judge.of(self.task, context)
        magnitude, phase = required_response(judge.transfer_function, self.task.target)
        spare = 0.5 * np.log(2)
        steepest = np.clip(np.degrees(phase.min()) - 2.0, -89.0, -75.0)
        phases = np.radians([steepest, -0.5])
        low = np.array([magnitude.min() - spare, phases[0]])
        return low, np.array([magnitude.max() + spare, phases[1]])

    def limits(self) -> dict[str, Range]:
        """How far searches and recordings go: a vehicle may be lighter than the prior's lightest.

        The compiled search goes anywhere that foreign recordings send it.
        """
        prior = self.task.prior
        lightest, heaviest = (mass - self.task.vehicle.M_0 for mass in _MASS)
        limits = {"M_delta": (lightest, heaviest), "v_x": (_SLOWEST, LARGEST["v_x"])}
        if self.linear:
            limits["mu_s"] = _FRICTION
        else:
            low, high = prior.M_delta
            spare = (high - low) / 2
            limits["M_delta"] = (max(low - spare, lightest), high + spare)
        ranges = {name: getattr(prior, name) for name in limits}
        return {
            name: (min(low, ranges[name][0]), max(high, ranges[name][1]))
            for name, (low, high) in limits.items()
        }


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """A search by differences that starts from where a rougher one ends."""

    plant: Plant
    rough: Search

    def __call__(self, u: Array, y: Array, theta: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Find parameters (B, 3) behind outputs (B, N), and whether the search converged."""
        start = np.clip(self.rough(u, y, theta)[0], *self.plant.limits)
        start[:, self.plant.known] = theta[:, self.plant.known]
        found = identify(self.plant, u, y, start, beyond=True)
        return found.theta, found.converged
