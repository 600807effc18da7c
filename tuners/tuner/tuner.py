"""The tuner: it tunes recordings, acts as a policy and is saved, whatever finds the gains."""

import os
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tuners.features.laguerre import Laguerre
from tuners.trust import fallback
from tuners.trust.black_box import black_box, functions_for, left_over
from tuners.trust.checks import Assessment, assess
from tuners.trust.feedback import opened, projected_on
from tuners.trust.findings import Findings
from tuners.trust.fit import fit
from tuners.trust.intervals import GAUSSIAN, Interval
from tuners.trust.response import Response
from tuners.trust.verdict import Finding, worst
from tuners.tuner import notes, tuner_file
from tuners.tuner.ladder import Climb, climb, left
from tuners.tuner.method import Gains, Method, Rung
from tuners.tuner.reasons import looped, reasons
from tuners.tuner.recording import Recording
from tuners.tuner.result import FittedPlant, Result
from yawrate_env import validation
from yawrate_env.loop.design import Status
from yawrate_env.plant.plant import Plant
from yawrate_env.plant.responses import OpenLoop

Array = NDArray[np.float64]

LONGEST = 200_000
"""Samples of one recording, at most."""

_SLOWEST = 0.1  # sampling time, in periods of the crossover
_COARSEST = 10.0  # sampling time, in those of the experiment, where there is no crossover
_MISSED = 0.01  # of the output's standard deviation: what a spline may miss between samples
_TOO_SLOW = "A spline misses part of the output between these slow samples: record faster."
_STRETCHED = (
    "The input is the experiment's, sample by sample, but the sampling time is not its {:g} s: "
    "check Ts."
)
_STILL = 1e-9  # of the experiment's largest input or output: smaller variations are none


def slowest(plant: Plant) -> float:
    """Longest sampling time of a usable recording [s]: the plant's own, or longer."""
    longest = _COARSEST * plant.Ts if plant.crossover is None else _SLOWEST / plant.crossover
    return max(longest, plant.Ts)


class Tuner:
    """A map from a recording to the gains of a controller, and the trust in them.

    Parameters
    ----------
    plant : Plant
        The plant that it tunes.
    method : Method
        Finds the gains: both stages, trained, or one of `rivals` or `direct`.
    training : dict, optional
        How it was trained, kept for the record.
    calibration, exact_calibration : tuple of float, optional
        Half widths of the counted metrics' intervals in standard deviations: of those that the
        recording supports, and of those if the plant's data are exact; those of a normal error
        if omitted.
    """

    def __init__(
        self,
        plant: Plant,
        method: Method,
        training: dict[str, Any] | None = None,
        calibration: tuple[float, ...] = (),
        exact_calibration: tuple[float, ...] = (),
    ) -> None:
        self.plant, self.method, self.training = plant, method, training or {}
        normal = (GAUSSIAN,) * len(plant.counted)
        self.calibration = calibration or normal
        self.exact_calibration = exact_calibration or normal

    def __repr__(self) -> str:
        return f"<Tuner {self.training.get('name', self.method.kind)}>"

    def gains(self, recording: Recording) -> Gains:
        """Gains for every episode; none without excitation, for methods that need it."""
        return self._excited(recording, self.method.gains(self.plant, recording))

    def tune(
        self,
        u: ArrayLike,
        y: ArrayLike,
        Ts: float | None = None,
        measured: Mapping[str, ArrayLike] | None = None,
        start: str = "auto",
        reference: ArrayLike | None = None,
        **parameters: ArrayLike | None,
    ) -> Result:
        """Tune from one recording, and check with it whether to trust the gains.

        Parameters
        ----------
        u, y : (N,)
            Input and measured output, in the plant's units.
        Ts : float, optional
            Sampling time [s].  Where it is not the plant's, the input is held between samples
            and the output follows a cubic spline.
        measured : dict, optional
            The plant's measured parameters: one value each, or one a sample.
        start : {"auto", "rest", "offset", "unknown"}
            Whether the recording starts from rest without offsets, at an operating point, whose
            output is an unknown constant, or in motion, in which case initial state, offset and
            trend are estimated too; found from the data if "auto".
            For plants whose responses do not add up the data cannot say, and rest is assumed.
        reference : (N,), optional
            Reference of the loop in which it was recorded, in the output's unit: what it explains
            of the input then takes the input's place (`tuners.trust.feedback`).
        **parameters
            Measured parameters by name, as in ``v_x=18.0``.

        Raises
        ------
        ValueError
            The recording cannot be used; the message says why and what to do.
        """
        measured = {} if measured is None else measured
        if not isinstance(measured, Mapping):
            raise ValueError(f"measured = {measured!r} is not a dict. Give {{name: value}}.")
        if twice := sorted(measured.keys() & parameters.keys()):
            raise ValueError(f"{twice[0]} is given twice. Leave out one of the two.")
        given = Recording.of(self.plant, u, y, Ts, {**measured, **parameters}, reference)
        return self.results(given, start)[0]

    def results(self, recording: Recording, start: str = "auto") -> tuple[Result, ...]:
        """Results for every episode, each as `tune` gives it."""
        plant, climbed, assessment = self.plant, *self.climb(recording, start)
        if recording.Ts > plant.Ts * (1 + notes.ROUNDED):
            values = _between(recording, assessment)
            message = plant.messages.get("between", _TOO_SLOW)
            missed = Finding(values, _MISSED, _MISSED, message)
            assessment = assessment.followed_by({"between": missed})
        if notes.stretched(plant, recording):
            asked = Finding(np.ones(len(recording)), 0.0, 0.0, _STRETCHED.format(plant.Ts))
            assessment = assessment.followed_by({"stretched": asked})
        given = [recording.part(slice(i, i + 1)) for i in range(len(recording))]
        return tuple(self._result(given[i], climbed, assessment, i) for i in range(len(given)))

    def _result(self, given: Recording, climbed: Climb, found: Assessment, i: int) -> Result:
        plant, checks, gains = self.plant, found.checks(i), climbed.gains
        verdict = worst([check.verdict for check in checks])
        alone = climbed.rung[i] >= Rung.BLACK_BOX
        explained = Rung.FITTED_PLANT in self.method.rungs and not looped(checks)
        why = left(self.plant, climbed, found, i) if explained else ()
        return Result(
            gains=self._named(gains.values[i]),
            intervals=_intervals(plant, found.metrics[i], found.spread[i], self.calibration),
            exact_intervals=_intervals(
                plant, found.exact_metrics[i], found.exact_spread[i], self.exact_calibration
            ),
            status=Status(gains.status[i]),
            converged=bool(gains.converged[i]),
            verdict=verdict,
            rung=Rung(climbed.rung[i]),
            left=why,
            reasons=reasons(plant, checks, why, Rung(climbed.rung[i])),
            notes=notes.projected(given, found.model.u[i % len(found.model.u)], found.model.Ts)
            + notes.notes(self.plant, given, found.fit, i, self.method.any_experiment)
            + notes.unfollowed(self._left_over)
            + notes.slow_integral(plant, gains.values[i], given.y.shape[1] * given.Ts),
            fallback=self._named(self.fallback),
            checks=checks,
            fit=FittedPlant.of(plant, found, i, alone),
            open_loop=_open_loop(gains.values[i], found, i) if alone else None,
            plant=self.plant,
        )

    def assess(self, recording: Recording, start: str = "auto") -> tuple[Gains, Assessment]:
        """Gains for every episode as `tune` gives them, and their assessment."""
        climbed, assessment = self.climb(recording, start)
        return climbed.gains, assessment

    def climb(self, recording: Recording, start: str = "auto") -> tuple[Climb, Assessment]:
        """Gains for every episode as `tune` gives them, whose they are, and their assessment."""
        plant, method = self.plant, self.method
        remedy = "Make one with Recording.of(plant, u, y, Ts)."
        validation.instance("recording", recording, Recording, remedy=remedy)
        validation.count("number of episodes", len(recording), remedy="Give one or more.")
        remedy = "Slower samples do not show what the plant does: record faster."
        validation.number("Ts", recording.Ts, at_most=slowest(plant), remedy=remedy)
        samples = recording.y.shape[1] * recording.Ts / plant.Ts
        remedy = "Cut to the best part, or decimate."
        validation.number("number of samples at the tuner's Ts", samples, at_most=LONGEST,
                          remedy=remedy)  # fmt: skip
        alone = method.rungs == (Rung.BLACK_BOX,)
        theta = recording.parameters(plant, needed=not alone)
        used = self._opened(recording, theta, start)
        model = black_box(plant, self.black_box, used.u, used.y, start, used.oversampled)
        own = self.gains(replace(used, y=model.y))
        still = self._still(used) if method.needs_excitation else np.zeros(len(used), np.bool_)
        fitted = fit(plant, model, used.y, theta)
        target = plant.loop_target
        response = None if target is None else Response.of(model, target)
        known = self._known(theta)
        climbed = climb(plant, method.rungs, own, fitted, response, known).without(still)
        assessment = assess(
            plant, model, fitted, response, used.y, climbed.judged, theta,
            anywhere=method.any_measured, alone=alone,
        )  # fmt: skip
        given = recording.u, recording.y, recording.Ts, recording.reference
        looped = Findings(plant, None).of_feedback(self.black_box, *given)
        return climbed, assessment.followed_by(looped)

    def _opened(self, recording: Recording, theta: Array, start: str) -> Recording:
        """Recordings at the plant's sampling time, those in a loop as if there were none."""
        plant, used = self.plant, recording.resampled(self.plant.Ts)
        if recording.reference is None:
            return used
        if not plant.linear:
            raise ValueError(
                "reference: the responses of this plant do not add up, and no part of its input "
                "can stand for the whole. Describe the loop as the experiment, with in_loop=True."
            )
        inputs = np.broadcast_to(recording.u, recording.y.shape)
        explained = projected_on(recording.reference, inputs, recording.Ts, self.black_box)
        u = replace(recording, u=explained).resampled(plant.Ts).u
        y = opened(plant, self.black_box, u, used.u, used.y, theta, start, used.oversampled)
        return replace(used, u=u, y=y, reference=None)

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
            One observation of the plant's environment, or a batch.

        Returns
        -------
        actions : (k,) or (B, k) float64
            Gains; the fallback where the tuner finds none.
        state
            As given.
        """
        recording, single = Recording.of_observations(self.plant, obs)
        actions = self.act(recording) if len(recording) else np.empty((0, len(self.plant.gains)))
        return (actions[0] if single else actions), state

    def act(self, recording: Recording) -> Array:
        """Gains (B, k), with the fallback where the tuner finds none."""
        values = self.gains(recording).values
        found = np.isfinite(values).all(axis=1, keepdims=True)
        return values if found.all() else np.where(found, values, self.fallback)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the tuner to a file, ``*.tuner``, completely or not at all."""
        settings = {
            "method": self.method.kind,
            **self.method.settings(),
            "training": self.training,
            "calibration": list(self.calibration),
            "exact_calibration": list(self.exact_calibration),
        }
        tuner_file.save(path, self.plant, settings, self.method.arrays())

    @cached_property
    def fallback(self) -> Array:
        """Gains (k,) that are stable for every plant of the prior (`tuners.trust.fallback`)."""
        return fallback.fallback(self.plant)

    @cached_property
    def _left_over(self) -> float:
        """Share of the outputs that the reference model cannot explain, of a nonlinear plant."""
        return 0.0 if self.plant.linear else left_over(self.plant, self.black_box)

    @cached_property
    def black_box(self) -> Laguerre:
        """Laguerre basis of the reference model."""
        return functions_for(self.plant)

    def _excited(self, recording: Recording, found: Gains) -> Gains:
        """Discard gains from recordings without excitation, for methods that need it."""
        return found.without(self._still(recording)) if self.method.needs_excitation else found

    def _still(self, recording: Recording) -> NDArray[np.bool_]:
        """Which recordings (B,) have a constant input or output.

        A constant input is a step from rest if the experiment holds one as long.
        """
        input, output, held = self._scales
        step = recording.y.shape[1] * recording.Ts <= held * (1 + 1e-9)
        u = np.abs(recording.u).max(axis=1) if step else np.ptp(recording.u, axis=1)
        return np.asarray((u <= _STILL * input) | (np.ptp(recording.y, axis=1) <= _STILL * output))

    @cached_property
    def _scales(self) -> tuple[float, float, float]:
        """Largest input and output of the experiment, and how long it holds an input [s]."""
        u = self.plant.u
        turns = np.flatnonzero(np.diff(u, prepend=np.nan, append=np.nan))
        longest = np.diff(turns).max(initial=1) * self.plant.Ts
        return np.abs(u).max(), np.ptp(self.plant.respond(self.plant.middle)), longest

    def _known(self, theta: Array) -> NDArray[np.bool_]:
        """Which recordings (B,) have measured parameters that the tuner was made for."""
        plant, within = self.plant, np.ones(len(theta), dtype=np.bool_)
        low, high = plant.limits if self.method.any_measured else plant.ranges
        for name, slack in plant.measured.items():
            (i,) = plant.indices((name,))
            within &= (theta[:, i] >= low[i] - slack) & (theta[:, i] <= high[i] + slack)
        return np.asarray(within)

    def _named(self, gains: Array) -> dict[str, float]:
        return dict(zip(self.plant.gains, map(float, gains), strict=True))


def _intervals(
    plant: Plant, metrics: Array, spread: Array, factors: tuple[float, ...]
) -> dict[str, Interval]:
    """Metrics (f,) plus and minus factors times their standard deviations (f,), by name."""
    ends = zip(plant.counted, metrics, np.array(factors) * spread, strict=True)
    return {name: Interval(float(v), float(v - h), float(v + h)) for name, v, h in ends}


def _open_loop(gains: Array, found: Assessment, i: int) -> OpenLoop | None:
    """What the recording alone shows of the loop; None where there is nothing to show."""
    if found.response is None or not np.isfinite(gains).all():
        return None
    return found.response.open_loop(gains, i)


def _between(given: Recording, found: Assessment) -> Array:
    """Relative error of a spline through the fitted plant's output at a slow log's samples."""
    simulated, Ts = found.fit.simulated, found.model.Ts
    times, at = Ts * np.arange(simulated.shape[1]), given.Ts * np.arange(given.y.shape[1])
    seen = np.stack([np.interp(at, times, row) for row in simulated])
    drawn = replace(given, y=seen).resampled(Ts).y
    with np.errstate(divide="ignore", invalid="ignore"):
        missed = np.mean((drawn - simulated[:, : drawn.shape[1]]) ** 2, axis=1)
        return np.asarray(np.sqrt(missed / simulated.var(axis=1)))
