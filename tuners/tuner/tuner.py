"""What every tuner can do: tune a log, act as a policy, be saved."""

import os
from abc import ABC, abstractmethod
from dataclasses import asdict, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tuners.trust.black_box import black_box, functions_for
from tuners.trust.checks import Assessment, assess
from tuners.trust.vehicle_fallback import fallback
from tuners.trust.vehicle_trust import Calibration, of_vehicles, result
from tuners.tuner import tuner_file as model_file
from tuners.tuner.recording import Recording
from tuners.tuner.result import TuningResult
from yawrate_env import validation
from yawrate_env.loop.design import Design, Status
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.excitation import RANDOM_ORDER
from yawrate_env.vehicle.episode import loops
from yawrate_env.vehicle.nonlinear import twin_from
from yawrate_env.vehicle.plausible import STEADY, STILL
from yawrate_env.vehicle.single_track import Context, Vehicle
from yawrate_env.vehicle.task import Prior, Task
from yawrate_env.vehicle.yaw_rate import SPEED_SLACK, yaw_rate

Array = NDArray[np.float64]

_SLOWEST = 0.1  # sampling time, in periods of the crossover
_LONGEST = 200_000  # samples of one episode
_FEW = 10  # samples for each distinct value, or more


def nominal_context(prior: Prior) -> Context:
    """The vehicle in the middle of the prior."""
    return Context.of(*(sum(r) / 2 for r in (prior.mu_s, prior.M_delta, prior.v_x)))


class Tuner(ABC):
    """A map from a recorded episode to the gains of a PI controller.

    Parameters
    ----------
    task : Task
        The vehicles, experiment and loop target it is made for.
    """

    kind: ClassVar[str]
    any_experiment: bool = False
    """Whether sampling time and length make no difference, so that no note is due."""
    needs_motion: ClassVar[bool] = True
    """Whether it finds nothing where command or yaw rate stand still."""

    def __init__(self, task: Task) -> None:
        self.task, self.calibration = task, Calibration()
        nominal = loops(task, nominal_context(task.prior)).design()
        self._fallback = float(nominal.kp[0]), float(nominal.Ti[0])

    def __repr__(self) -> str:
        training = getattr(self, "training", {})
        return f"<{type(self).__name__} {training.get('name', self.kind)}>"

    @abstractmethod
    def gains(self, recording: Recording) -> tuple[Design, NDArray[np.bool_]]:
        """Gains for every episode, and where the numerics converged."""

    def tune(
        self,
        u: ArrayLike,
        y: ArrayLike,
        Ts: float,
        v_x: ArrayLike | None = None,
        start: str = "auto",
    ) -> TuningResult:
        """Tune from one recorded episode, and ask the recording whether to trust the gains.

        Parameters
        ----------
        u : (N,)
            Steering command [rad].
        y : (N,)
            Measured yaw rate [rad/s].
        Ts : float
            Sampling time [s].
        v_x : float or (N,), optional
            Speed [m/s]; that of the tuner's own vehicles if not given.
        start : {"auto", "rest", "unknown"}
            Whether the recording starts from rest without offsets, or in mid-drive, in
            which case its start and offsets are estimated along; found from the data if
            not given.

        Returns
        -------
        TuningResult
            Where the tuner finds no gains, those of the nominal vehicle, and a note.

        Raises
        ------
        ValueError
            The episode cannot be used; the message says why and what to do.
        """
        given = Recording.of(u, y, Ts, v_x)
        design, converged, found = self._assessed(given, start)
        notes = self._differences(given)
        if design.status[0] == Status.UNREACHABLE:
            notes += ("No gains found: these are the nominal vehicle's.",)
        if not converged[0]:
            notes += ("The fit did not converge: check the recording.",)
        notes += _quantised(given.y[0], found.fit.residual[0])
        return result(
            found, design, bool(converged[0]), notes, self.calibration, fallback(self.task)
        )

    def assess(self, recording: Recording, start: str = "auto") -> tuple[Design, Assessment]:
        """Gains for every episode as `tune` gives them, and what the recordings say of them."""
        design, _, found = self._assessed(recording, start)
        return design, found

    def _assessed(
        self, recording: Recording, start: str
    ) -> tuple[Design, NDArray[np.bool_], Assessment]:
        """Gains, where the tuner's own numerics converged, and what the recordings say."""
        slowest = _SLOWEST / self.task.target.crossover
        remedy = "Slower samples do not show what happens at the crossover: record faster."
        validation.number("Ts", recording.Ts, at_most=slowest, remedy=remedy)
        samples = recording.y.shape[1] * recording.Ts / self.task.experiment.Ts
        remedy = "Cut to the best 20 s, or decimate."
        validation.number("number of samples at the tuner's Ts", samples, at_most=_LONGEST,
                          remedy=remedy)  # fmt: skip
        recording = recording.resampled(self.task.experiment.Ts)
        plant, speeds = self.plant, self.speeds(recording)
        model = black_box(
            plant, functions_for(plant), recording.u, recording.y, start, recording.oversampled
        )
        design, converged = self._moved(recording, *self.gains(replace(recording, y=model.y)))
        design = Design(*self._usable(design), design.status)
        begin = np.tile(plant.middle, (len(recording), 1))
        begin[:, -1] = speeds
        gains, solved = np.stack([design.kp, design.Ti], axis=1), design.status == Status.OK
        found = assess(plant, model, recording.y, gains, begin, converged & solved)
        return design, converged, of_vehicles(found, speeds, self.speed_range)

    def predict(
        self,
        obs: ArrayLike,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[Array, Any]:
        """Act as a policy, with the signature that Stable-Baselines3's tools call.

        Parameters
        ----------
        obs : (rows, N) or (B, rows, N)
            One observation of ``yawrate/PITuning-v0``, or a batch.

        Returns
        -------
        actions : (2,) or (B, 2) float64
            (kp, Ti); the nominal vehicle's where the tuner finds none.
        state
            As given.
        """
        samples = np.shape(obs)[-1] if np.ndim(obs) else 0
        experiment = self.task.experiment
        recording, single = Recording.of_observations(obs, experiment.Ts)
        if samples != experiment.N:
            raise ValueError(
                f"obs has {samples} samples, this tuner's episodes have {experiment.N} of "
                f"{experiment.Ts:g} s. Use tune(u, y, Ts), or train a tuner for this experiment."
            )
        actions = self.act(recording) if len(recording) else np.empty((0, 2))
        return (actions[0] if single else actions), state

    def act(self, recording: Recording) -> Array:
        """(B, 2) of usable (kp, Ti); the nominal vehicle's where the tuner finds none."""
        design, _ = self._moved(recording, *self.gains(recording))
        return np.stack(self._usable(design), axis=1)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the tuner to one file, completely or not at all."""
        model_file.write(path, {"kind": self.kind, **self.settings()}, self.arrays())

    def settings(self) -> dict[str, Any]:
        """What to save beside the arrays, as plain JSON values."""
        return {"task": asdict(self.task), "calibration": asdict(self.calibration)}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Learned numbers to save."""
        return {}

    @classmethod
    def from_file(cls, settings: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> Self:
        """Rebuild from what `settings` and `arrays` gave."""
        return cls(task_from(settings))

    @cached_property
    def plant(self) -> Plant:
        """Its vehicles, described as any plant is."""
        return yaw_rate(self.task)

    @property
    def speed_range(self) -> tuple[float, float]:
        """Lowest and highest speed that it was made for [m/s]."""
        return self.task.prior.v_x

    def speeds(self, recording: Recording) -> Array:
        """Speed of every episode [m/s], (B,): recorded, or the tuner's own single one."""
        if recording.v_x is not None:
            return recording.v_x
        low, high = self.task.prior.v_x
        if low != high:
            raise ValueError(
                f"v_x is needed: this tuner covers {low:g} to {high:g} m/s. "
                "Give the speed of the recording."
            )
        return np.full(len(recording), low)

    def _moved(
        self, recording: Recording, design: Design, converged: NDArray[np.bool_]
    ) -> tuple[Design, NDArray[np.bool_]]:
        """Nothing in place of what was made of recordings in which nothing moves.

        A constant command is a step from rest, if it is not held for longer than a register
        may hold it.
        """
        held = RANDOM_ORDER * self.task.experiment.bit_time
        step = recording.y.shape[1] * recording.Ts <= held * (1 + 1e-9)
        command = np.abs(recording.u).max(axis=1) if step else np.ptp(recording.u, axis=1)
        turn = np.ptp(recording.y, axis=1)
        still = (np.minimum(command, turn) <= STILL) & self.needs_motion
        kp, Ti = (np.where(still, np.nan, x) for x in (design.kp, design.Ti))
        status = np.where(still, int(Status.UNREACHABLE), design.status)
        return Design(kp, Ti, status), converged & ~still

    def _usable(self, design: Design) -> tuple[Array, Array]:
        found = np.isfinite(design.kp) & np.isfinite(design.Ti)
        return np.where(found, design.kp, self._fallback[0]), np.where(
            found, design.Ti, self._fallback[1]
        )

    def _differences(self, recording: Recording) -> tuple[str, ...]:
        experiment, (low, high) = self.task.experiment, self.speed_range
        notes = []
        if not self.any_experiment and not np.isclose(recording.Ts, experiment.Ts):
            notes.append(f"Ts is {recording.Ts:g} s, made for {experiment.Ts:g} s.")
        if not self.any_experiment and recording.y.shape[1] != experiment.N:
            notes.append(f"{recording.y.shape[1]} samples, made for {experiment.N}.")
        slack = SPEED_SLACK
        if recording.v_x is not None and not low - slack <= recording.v_x[0] <= high + slack:
            made = f"{low:g} m/s" if low == high else f"{low:g} to {high:g} m/s"
            notes.append(f"Speed is {recording.v_x[0]:.2f} m/s, made for {made}.")
        if recording.speed_variation > STEADY:
            notes.append(
                f"The speed varies by {recording.speed_variation:.0%} of its mean, which counts."
            )
        return tuple(notes)


def _quantised(y: Array, residual: Array) -> tuple[str, ...]:
    """A note where few values (N,) are so far apart that rounding is not just more noise."""
    values = np.unique(y)
    if not 1 < len(values) < len(y) / _FEW:
        return ()
    step = float(np.diff(values).min())
    if step <= np.sqrt(np.mean(residual**2)):
        return ()
    return (
        f"The yaw rate is quantised in steps of {step:.2g} rad/s: intervals may be too narrow.",
    )


def task_from(settings: dict[str, Any]) -> Task:
    """Rebuild the task that `Tuner.settings` saved."""
    from yawrate_env.loop.target import Target
    from yawrate_env.vehicle.task import Experiment

    saved = settings["task"]
    return Task(
        Vehicle(**saved["vehicle"]),
        Prior(**{name: tuple(values) for name, values in saved["prior"].items()}),
        Experiment(**saved["experiment"]),
        Target(**saved["target"]),
        twin=twin_from(saved.get("twin", {})),
    )
