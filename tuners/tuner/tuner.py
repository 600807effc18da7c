"""The tuner: it tunes recordings, acts as a policy and is saved, whatever finds the gains."""

import os
from collections.abc import Mapping, Sequence
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
from tuners.tuner.gain_intervals import design_slopes, exact_gain_intervals, gain_intervals
from tuners.tuner.ladder import Climb, climb, left
from tuners.tuner.look import Look
from tuners.tuner.method import Gains, Method, Rung
from tuners.tuner.pooling.results import pools
from tuners.tuner.reasons import looped, reasons
from tuners.tuner.recording import Recording
from tuners.tuner.result import FittedPlant, Result
from tuners.tuner.rivals import BlackBoxRule, Fitted
from tuners.tuner.sampling import check_sampling, sampled
from yawrate_env import validation
from yawrate_env.loop.design import Status
from yawrate_env.loop.target import Target
from yawrate_env.plant.entry import with_target
from yawrate_env.plant.plant import Plant
from yawrate_env.plant.responses import OpenLoop

Array = NDArray[np.float64]

_STILL = 1e-9  # of the experiment's largest input or output: smaller variations are none


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

    @property
    def rungs(self) -> tuple[Rung, ...]:
        """Whose gains may answer: not a learner's that is well above the bound."""
        rungs = self.method.rungs
        if self.training.get("answers") == Rung.FITTED_PLANT.name and len(rungs) > 1:
            return tuple(rung for rung in rungs if rung is not Rung.METHOD)
        return rungs

    def gains(self, recording: Recording) -> Gains:
        """Gains for every episode; none without excitation, for methods that need it."""
        held = recording.resampled(recording.Ts)
        return self._excited(held, self.method.gains(self.plant, held))

    def tune(
        self,
        u: ArrayLike,
        y: ArrayLike,
        Ts: float | None = None,
        measured: Mapping[str, ArrayLike] | None = None,
        start: str = "auto",
        input: str | None = None,
        reference: ArrayLike | None = None,
        **parameters: ArrayLike | None,
    ) -> Result:
        """Tune from one recording, and check with it whether to trust the gains.

        Parameters
        ----------
        u, y : (N,)
            Input and measured output, in the plant's units; of several channels (m, N), (q, N).
        Ts : float, optional
            Sampling time [s].  Where it is not the plant's, the output follows a cubic spline.
        measured : dict, optional
            The plant's measured parameters: one value each, or one a sample.
        start : {"auto", "rest", "offset", "unknown"}
            Whether the recording starts from rest without offsets, at an operating point, whose
            output is an unknown constant, or in motion, in which case initial state, offset and
            trend are estimated too; found from the data if "auto".
            For plants whose responses do not add up the data cannot say, and rest is assumed.
        input : {"held", "lines"}, optional
            Whether the input keeps a sample's value until the next, or is joined by lines; as the
            plant's recordings do if omitted.
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
        given = Recording.of(self.plant, u, y, Ts, {**measured, **parameters}, input, reference)
        return self.results(given, start)[0]

    def results(self, recording: Recording, start: str = "auto") -> tuple[Result, ...]:
        """Results for every episode, each as `tune` gives it."""
        climbed, assessment = self.climb(recording, start)
        assessment = sampled(self.plant, recording, assessment)
        given = [recording.part(slice(i, i + 1)) for i in range(len(recording))]
        slopes = design_slopes(self.plant, assessment.fit.theta)
        return tuple(
            self._result(part, climbed, assessment, i, slopes) for i, part in enumerate(given)
        )

    def pool(
        self,
        recordings: Sequence[Recording],
        at: Mapping[str, float] | None = None,
        *,
        names: Sequence[str] = (),
        validate: Recording | None = None,
        start: str = "auto",
    ) -> Result:
        """Tune from several recordings of one plant, whose information adds up.

        Friction, load and whatever else is unknown is the same in all of them; measured
        parameters, such as a speed, are each recording's own.

        Parameters
        ----------
        recordings : sequence of Recording
            One episode each, of any length and sampling time.
        at : dict, optional
            Measured parameters that the gains are for; what the recordings have in common, if
            omitted.
        names : sequence of str, optional
            Of the recordings, and of the one that validates: ``recording 1`` and so on if omitted.
        validate : Recording, optional
            A further recording, which the answer does not come from, to hold against it.
        start : str
            As for `tune`.

        Raises
        ------
        ValueError
            A recording cannot be used, or the recordings have no operating point in common.
        """
        return self.pools(recordings, [at], names=names, validate=validate, start=start)[0]

    def pools(
        self,
        recordings: Sequence[Recording],
        ats: Sequence[Mapping[str, float] | None],
        *,
        names: Sequence[str] = (),
        validate: Recording | None = None,
        start: str = "auto",
    ) -> tuple[Result, ...]:
        """Tune from several recordings for several operating points, each as `pool` does."""
        return pools(self, recordings, ats, names, validate, start)

    def _result(
        self, given: Recording, climbed: Climb, found: Assessment, i: int, slopes: Array
    ) -> Result:
        rungs = self.rungs
        explained = Rung.FITTED_PLANT in rungs and not looped(found.checks(i))
        why = left(rungs, self.plant, climbed, found, i) if explained else ()
        used = found.model.u[i % len(found.model.u)]
        said = notes.projected(given, used, found.model.Ts)
        said += notes.notes(self.plant, given, found.fit, i, self.method.any_experiment)
        return self.answer(climbed, found, i, why, said, given.y.shape[-1] * given.Ts, slopes)

    def answer(
        self,
        climbed: Climb,
        found: Assessment,
        i: int,
        why: tuple[str, ...],
        said: tuple[str, ...],
        seconds: float,
        slopes: Array | None = None,
    ) -> Result:
        """The result of recording `i`.

        Parameters
        ----------
        why : tuple of str
            Why higher rungs were left.
        said : tuple of str
            Notes on the recording.
        seconds : float
            How long it is.
        slopes : (B, k, q) float64, optional
            `design_slopes` at the fitted plants.
        """
        plant, checks, gains = self.plant, found.checks(i), climbed.gains
        verdict = worst([check.verdict for check in checks])
        alone = climbed.rung[i] >= Rung.BLACK_BOX
        widest = max(self.calibration)
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
            notes=said
            + notes.unfollowed(self._left_over)
            + notes.hidden(self.training.get("hides", ()))
            + notes.slow_integral(plant, gains.values[i], seconds),
            fallback=self._named(self.fallback),
            checks=checks,
            gain_intervals=gain_intervals(plant, gains.values[i], found, i, widest),
            exact_gain_intervals=exact_gain_intervals(
                plant, gains.values[i], found, i, slopes=slopes
            ),
            fit=FittedPlant.of(plant, found, i, alone),
            open_loop=_open_loop(gains.values[i], found, i) if alone else None,
            response=None if found.response is None else found.response.part(i),
            plant=self.plant,
        )

    def for_target(self, target: Target, rung: Rung) -> "Tuner":
        """A tuner for another target of the loop, which answers as `rung` did, or from below it.

        A learner knows one target; the fitted plant and the black box serve any, by the design
        rule.

        Raises
        ------
        ValueError
            The plant has one target only.
        """
        alone = rung >= Rung.BLACK_BOX or self.method.rungs == (Rung.BLACK_BOX,)
        method = BlackBoxRule() if alone else Fitted()
        plant = with_target(self.plant, target)
        return Tuner(plant, method, self.training, self.calibration, self.exact_calibration)

    def assess(self, recording: Recording, start: str = "auto") -> tuple[Gains, Assessment]:
        """Gains for every episode as `tune` gives them, and their assessment."""
        climbed, assessment = self.climb(recording, start)
        return climbed.gains, assessment

    def climb(self, recording: Recording, start: str = "auto") -> tuple[Climb, Assessment]:
        """Gains for every episode as `tune` gives them, whose they are, and their assessment."""
        plant, method, seen = self.plant, self.method, self.look(recording, start)
        known = self.known(seen.theta)
        climbed = climb(plant, self.rungs, seen.own, seen.fit, seen.response, known)
        climbed = climbed.without(seen.still)
        assessment = assess(
            plant, seen.model, seen.fit, seen.response, seen.used.y, climbed.judged, seen.theta,
            anywhere=method.any_measured, alone=method.rungs == (Rung.BLACK_BOX,),
        )  # fmt: skip
        return climbed, assessment.followed_by(self.looped(recording))

    def looped(self, recording: Recording) -> dict[str, Finding]:
        """Whether inputs follow outputs, as in a loop that nobody named."""
        given = recording.u, recording.y, recording.Ts, recording.reference
        return Findings(self.plant, None).of_feedback(self.black_box, *given)

    def look(self, recording: Recording, start: str = "auto") -> Look:
        """Models of every episode, and the method's own gains."""
        plant, method = self.plant, self.method
        remedy = "Make one with Recording.of(plant, u, y, Ts)."
        validation.instance("recording", recording, Recording, remedy=remedy)
        validation.count("number of episodes", len(recording), remedy="Give one or more.")
        check_sampling(plant, recording)
        alone = method.rungs == (Rung.BLACK_BOX,)
        theta = recording.parameters(plant, needed=not alone)
        if recording.reference is not None and start == "auto":
            start = "unknown"  # what went before is in the loop; coloured noise hides it from tests
        used = self._opened(recording, theta, start)
        model = black_box(plant, self.black_box, used.u, used.y, start, used.oversampled)
        own = self.gains(replace(used, y=plant.unstacked(model.y)))
        still = self._still(used) if method.needs_excitation else np.zeros(len(used), np.bool_)
        fitted = fit(plant, model, used.y, theta)
        target = plant.loop_target
        response = None if target is None else Response.of(model, target)
        return Look(recording, used, theta, model, own, still, fitted, response)

    def response(self, recording: Recording, start: str = "auto") -> Response:
        """What recordings alone show of the plant around the target's crossover.

        ``ValueError`` where the plant's target is no phase margin and crossover of a PI.
        """
        plant, target = self.plant, self.plant.loop_target
        if target is None:
            raise ValueError("plant.parametrisation: this plant's target is no loop of a PI.")
        used = self._opened(recording, recording.parameters(plant, needed=False), start)
        return Response.of(
            black_box(plant, self.black_box, used.u, used.y, start, used.oversampled), target
        )

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
        return 0.0 if self.plant.linear else left_over(self.plant.emulated(), self.black_box)

    @cached_property
    def black_box(self) -> Laguerre:
        """Laguerre basis of the reference model."""
        return functions_for(self.plant.emulated())

    def _excited(self, recording: Recording, found: Gains) -> Gains:
        """Discard gains from recordings without excitation, for methods that need it."""
        return found.without(self._still(recording)) if self.method.needs_excitation else found

    def _still(self, recording: Recording) -> NDArray[np.bool_]:
        """Which recordings (B,) have a constant input or output, of several any.

        A constant input is a step from rest if the experiment holds one as long.
        """
        input, output, held = self._scales
        step = recording.y.shape[-1] * recording.Ts <= held * (1 + 1e-9)
        u = np.abs(recording.u).max(axis=-1) if step else np.ptp(recording.u, axis=-1)
        still = u <= _STILL * input, np.ptp(recording.y, axis=-1) <= _STILL * output
        one, other = (s if s.ndim == 1 else s.any(axis=1) for s in still)
        return np.asarray(one | other)

    @cached_property
    def _scales(self) -> tuple[Array, Array, float]:
        """Largest inputs and outputs of the experiment, and how long it holds an input [s]."""
        u = self.plant.u
        held = (np.flatnonzero(np.diff(row, prepend=np.nan, append=np.nan))
                for row in np.atleast_2d(u))  # fmt: skip
        longest = max(np.diff(turns).max(initial=1) for turns in held) * self.plant.Ts
        y = self.plant.emulated().respond(self.plant.middle)[0]
        return np.abs(u).max(axis=-1), np.ptp(y, axis=-1), longest

    def known(self, theta: Array) -> NDArray[np.bool_]:
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
