"""The paper's case as a plant: a `Task`'s vehicles, experiment and loop target.

Parameters are ``(mu_s, M_delta, v_x)``: friction and extra mass are unknown, the speed is
measured with every recording.  Further ones that the prior names follow in the order of
`LABELS`.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawrate_env.loop.design import Status, required_response
from yawrate_env.loop.discretisation import DiscretePlant
from yawrate_env.loop.loops import Loops
from yawrate_env.plant.control_loop import ControlLoop
from yawrate_env.plant.distributions import Range
from yawrate_env.plant.metric import Metric
from yawrate_env.plant.noise import snr
from yawrate_env.plant.parametrisation import loop
from yawrate_env.plant.pi_loop import CROSSOVER_SCALE, GAINS, PHASE_SCALE
from yawrate_env.plant.plant import Plant
from yawrate_env.plant.responses import ClosedLoop
from yawrate_env.plant.simulator import Out, Written
from yawrate_env.plant.sliders import Sliders
from yawrate_env.plant.suspect import Suspect
from yawrate_env.vehicle.actuator import actuated
from yawrate_env.vehicle.episode import excitation, loops, plants, respond, simulated
from yawrate_env.vehicle.plausible import LARGEST_ANGLE, LARGEST_SPEED, LARGEST_YAW_RATE
from yawrate_env.vehicle.sensitivity import LogSensitivity
from yawrate_env.vehicle.single_track import Context, bounds, context_of
from yawrate_env.vehicle.suspects import suspects
from yawrate_env.vehicle.task import Task
from yawrate_env.vehicle.twin import LinearTwin
from yawrate_env.vehicle.words import CAUTIONS, MESSAGES, SYNONYMS

Array = NDArray[np.float64]
Integers = NDArray[np.uint64]

SPEED_SLACK = 0.25
"""How far outside the prior a recording's speed may lie [m/s]."""

BLACK_BOX = (24, 16.0)
"""Explains vehicles from 10 to 33 m/s to -45 dB or better, at 20 m/s to -80 dB."""

METRICS = {
    "phase_margin [deg]": Metric(PHASE_SCALE, error=1.5, spread=0.9, widest=5.0),
    "crossover [Hz]": Metric(CROSSOVER_SCALE, error=0.075, spread=0.045, widest=0.25),
    "gain_margin [dB]": Metric(np.inf),
}

LABELS = {
    "mu_s": "friction",
    "M_delta": "extra mass [kg]",
    "v_x": "speed [m/s]",
    "J_z": "yaw inertia [kg m^2]",
    "l_f": "front axle distance [m]",
    "l_r": "rear axle distance [m]",
    "C_f": "front stiffness [N/rad]",
    "C_r": "rear stiffness [N/rad]",
    "l_rel_f": "front relaxation length [m]",
    "l_rel_r": "rear relaxation length [m]",
    "omega_n": "actuator bandwidth [rad/s]",
    "xi": "actuator damping",
    "dead_time": "dead time [s]",
    "sensor_lag": "sensor lag [s]",
}

EXTRAPOLATION = {"mu_s": (1.1, 1.3), "M_delta": (300.0, 500.0)}
"""Stickier and heavier than anything in eq. (12)."""

COMMAND_LIMITS = (float(np.radians(-30.0)), float(np.radians(30.0)))
"""Road-wheel angle of exported controllers [rad]."""

IN_DEGREES = "steering [deg]", "yaw rate [deg/s]"
_DEGREE = float(np.degrees(1.0))
DISPLAY = (IN_DEGREES[0], _DEGREE), (IN_DEGREES[1], _DEGREE)
"""Input and output in pictures and reports."""

_LINEAR = 4.0  # m/s^2 of lateral acceleration, beyond which tyres saturate on dry asphalt
_FRICTION, _MASS = (1e-3, 1e2), (1.0, 1e6)  # bounds that no vehicle reaches
_LESS, _MORE = 0.95, 1.05  # of constants
_LENGTHS, _SNR = (0.5, 2.0), (14.0, 40.0)  # of the experiment, and dB
_SLOWEST = 0.1  # m/s: at rest the single-track vehicle has no steady answer


def from_settings(**task: Any) -> Plant:
    """The plant of a task that `Task.settings` wrote: what saved tuners name as their entry."""
    return yaw_rate(Task.of(task))


@lru_cache(maxsize=32)
def yaw_rate(task: Task, check: bool = True) -> Plant:
    """Describe a task's vehicles, experiment and loop target as a plant.

    The simulator is the task's twin; loops are evaluated on its linearisation.

    Parameters
    ----------
    check : bool
        False also accepts tasks for which no tuner can be trained, such as those whose vehicle
        in the middle of the prior is unstable: environments show them nevertheless.
    """
    experiment, prior, vehicles = task.experiment, task.prior.ranges, Vehicles(task)
    straight = replace(task, twin=LinearTwin())
    return Plant(
        prior=prior,
        measured={"v_x": SPEED_SLACK},
        simulate=vehicles.simulate,
        design=vehicles.design,
        evaluate=vehicles.evaluate,
        gains=GAINS,
        metrics=METRICS,
        target=(task.target.phase_margin, task.target.crossover),
        parametrisation=loop(task.target),
        u=excitation(experiment, np.zeros(1, np.uint64))[0],
        excite=vehicles.excite if experiment.register == "random" else None,
        Ts=experiment.Ts,
        noise=snr(experiment.snr_db),
        linear=vehicles.linear,
        crossover=task.target.crossover,
        plausible=(LARGEST_ANGLE, LARGEST_YAW_RATE),
        signals=("steering command [rad]", "yaw rate [rad/s]"),
        labels={name: LABELS[name] for name in prior},
        synonyms=SYNONYMS,
        cautions=CAUTIONS,
        actuator=vehicles.actuator if vehicles.actuator_known else None,
        remarks=remarks,
        suspects=vehicles.suspects,
        doubtful=vehicles.doubtful,
        messages=MESSAGES,
        record=vehicles.record,
        sensitivity=vehicles.sensitivity if vehicles.exact_slopes else None,
        linear_model=None if vehicles.linear else yaw_rate(straight, check=check),
        search_limits=vehicles.limits(),
        action_bounds=None if task.prior.others else vehicles.action_bounds,
        loop=vehicles.loop,
        speeds=vehicles.speeds,
        sliders=vehicles.sliders,
        display=DISPLAY,
        command_limits=COMMAND_LIMITS,
        black_box=BLACK_BOX,
        entry=f"{__name__}:{from_settings.__name__}",
        arguments=task.settings(),
        extrapolation=EXTRAPOLATION,
        check=check,
    )


def remarks(u: Array, y: Array, measured: Mapping[str, Array]) -> list[str]:
    """Note where tyres leave their linear range."""
    lateral = float(np.abs(y * measured["v_x"]).max())
    if lateral <= _LINEAR:
        return []
    return [f"Lateral acceleration reaches {lateral:.1f} m/s^2, where tyres are no longer linear."]


@lru_cache(maxsize=1)
def _loops(task: Task, theta: bytes) -> Loops:
    """Keep the last, since reward and oracle are asked for the same vehicles."""
    others = task.prior.others
    return loops(task, context_of(np.frombuffer(theta).reshape(-1, 3 + len(others)), others))


@dataclass(frozen=True, slots=True)
class Vehicles:
    """The functions of a task's plant, for parameters (B, p)."""

    task: Task

    @property
    def linear(self) -> bool:
        """Whether the twin is linear."""
        return self.task.twin.linear

    @property
    def exact_slopes(self) -> bool:
        """Whether friction and mass are all that is unknown of vehicles of the sixth order."""
        known = self.task.vehicle
        delayed = known.dead_time > 0 or known.sensor_lag > 0
        return self.linear and not self.task.prior.others and not delayed

    @property
    def actuator_known(self) -> bool:
        """Whether all vehicles' actuators respond alike."""
        return not {"omega_n", "xi", "dead_time"} & set(self.task.prior.others)

    def context(self, theta: Array) -> Context:
        """Parameters (B, p) as vehicles."""
        return context_of(theta, self.task.prior.others)

    def simulate(self, theta: Array, u: Array, rng: Any) -> Array:
        """Noise-free yaw rates (B, N) from rest; nothing in a twin is random."""
        return simulated(self.task, self.context(theta), np.atleast_2d(u))

    def suspects(self) -> tuple[Suspect, ...]:
        """What may be wrong with the vehicle's data or with a log."""
        return suspects(self.task)

    def doubtful(self, rng: np.random.Generator) -> Plant:
        """Vehicles whose constants are off by up to 5 %, 14 to 40 dB, half to twice as long."""
        task, given = self.task, self.task.prior.ranges
        constants = {
            name: (_LESS * value, _MORE * value)
            for name, value in asdict(task.vehicle).items()
            if name in LABELS and name not in given and value > 0 and self.linear
        }
        experiment = replace(
            task.experiment,
            N=int(task.experiment.N * rng.uniform(*_LENGTHS)),
            snr_db=rng.uniform(*_SNR),
        )
        prior = replace(task.prior, **constants)
        return yaw_rate.__wrapped__(replace(task, prior=prior, experiment=experiment), check=False)

    def record(
        self, theta: Array, u: Array, keys: Integers, out: Out, written: Written
    ) -> NDArray[np.floating]:
        """Measured yaw rates, as the environment has them."""
        return respond(self.task, self.context(theta), u, keys, out, written)

    def excite(self, integers: Integers) -> Array:
        """A random register for each."""
        return excitation(self.task.experiment, integers)

    def loops(self, theta: Array) -> Loops:
        """PI loops around the linear vehicles."""
        return _loops(self.task, np.ascontiguousarray(theta).tobytes())

    @property
    def sensitivity(self) -> LogSensitivity:
        """Exact slopes of the linear vehicles' yaw rates."""
        task, prior = self.task, self.task.prior
        friction, mass = (min(ends) < max(ends) for ends in (prior.mu_s, prior.M_delta))
        return LogSensitivity(task.vehicle, task.experiment.Ts, friction, mass)

    def design(self, theta: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Gains (B, 2), and whether they reach the target; ``nan`` where no PI comes near it."""
        found = self.loops(theta).design()
        return np.stack([found.kp, found.Ti], axis=1), found.status == Status.OK

    def evaluate(self, theta: Array, gains: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Phase margin [deg], crossover [Hz] and gain margin [dB] (B, 3), and stability (B,)."""
        found = self.loops(theta).evaluate(*gains.T)
        margins = found.margins.phase_margin, found.margins.crossover, found.margins.gain_margin
        return np.stack(margins, axis=1), found.stable

    def actuator(self, signal: Array, Ts: float) -> Array:
        """The steering actuator's response to a signal (N,), late by the dead time."""
        late = self.task.vehicle.dead_time
        if late > 0:
            time = Ts * np.arange(len(signal))
            signal = np.interp(time - late, time, signal)
        return actuated(signal, Ts, self.task.vehicle)

    def loop(self, theta: Array, gains: Array) -> ClosedLoop:
        """One vehicle's, for small steps: in degrees, as people read them."""
        return self._drawn.around(theta, gains)

    def speeds(self, theta: Array) -> dict[str, Array]:
        """Gains (2,) of slower and faster loops around one vehicle."""
        return self._drawn.speeds(theta)

    def sliders(self, theta: Array) -> Sliders:
        """What reports let their reader move of the loop around one vehicle."""
        return self._drawn.sliders(theta)

    @property
    def _drawn(self) -> ControlLoop:
        return ControlLoop(self.discrete, self.task.experiment.Ts, self.task.target, IN_DEGREES)

    def discrete(self, theta: Array, Ts: float) -> DiscretePlant:
        """The linear vehicles at a sampling time [s]."""
        return plants(self.task.vehicle, self.context(theta), Ts)

    def action_bounds(self) -> tuple[Array, Array]:
        """Log magnitudes and phases [rad] of the controller at the crossover, for agents.

        The magnitudes that vehicles of the prior need and half an octave more; most of the
        phases that a PI has, or nearly all of them where the prior needs them.
        """
        ranges = self.task.prior.ranges.values()
        grid = np.meshgrid(*(np.linspace(low, high, 3) for low, high in ranges))
        context = Context.of(*(axis.ravel() for axis in grid))
        found = loops(self.task, context)
        magnitude, phase = required_response(found.transfer_function, self.task.target)
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
        limits = {"M_delta": (lightest, heaviest), "v_x": (_SLOWEST, LARGEST_SPEED)}
        if self.linear:
            limits["mu_s"] = _FRICTION
        else:
            low, high = prior.M_delta
            spare = (high - low) / 2
            limits["M_delta"] = (max(low - spare, lightest), high + spare)
        for name in prior.others:
            low, high = getattr(prior, name)
            spare, (least, largest) = (high - low) / 2, bounds(name)
            limits[name] = max(low - spare, low / 2, least), min(high + spare, largest)
        return {
            name: (min(low, *prior.ranges[name]), max(high, *prior.ranges[name]))
            for name, (low, high) in limits.items()
        }
