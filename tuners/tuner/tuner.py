"""The tuner: it tunes recordings, acts as a policy and is saved, whatever finds the gains."""

import os
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tuners.trust import fallback
from tuners.trust.checks import Assessment, assess
from tuners.trust.intervals import GAUSSIAN
from tuners.tuner import notes, tuner_file
from tuners.tuner.answers import Answers
from tuners.tuner.gain_intervals import design_slopes
from tuners.tuner.inspection import Inspection
from tuners.tuner.ladder import Climb, climb, left
from tuners.tuner.method import Gains, Method, Rung
from tuners.tuner.pooling.results import pools
from tuners.tuner.reasons import looped
from tuners.tuner.recording import Recording
from tuners.tuner.result import Result
from tuners.tuner.rivals import BlackBoxRule, Fitted
from tuners.tuner.sampling import sampled
from yawrate_env.loop.target import Target
from yawrate_env.plant.entry import with_target
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]


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
        self.method, self.training = method, training or {}
        self.inspection = Inspection(plant, method)
        normal = (GAUSSIAN,) * len(plant.counted)
        self.calibration = calibration or normal
        self.exact_calibration = exact_calibration or normal

    def __repr__(self) -> str:
        return f"<Tuner {self.training.get('name', self.method.kind)}>"

    @property
    def plant(self) -> Plant:
        """The plant that it tunes; it may be given another simulator."""
        return self.inspection.plant

    @plant.setter
    def plant(self, plant: Plant) -> None:
        self.inspection.plant = plant

    @property
    def rungs(self) -> tuple[Rung, ...]:
        """Whose gains may answer: not a learner's that is well above the bound."""
        rungs = self.method.rungs
        if self.training.get("answers") == Rung.FITTED_PLANT.name and len(rungs) > 1:
            return tuple(rung for rung in rungs if rung is not Rung.METHOD)
        return rungs

    def gains(self, recording: Recording) -> Gains:
        """Gains for every episode; none without excitation, for methods that need it."""
        return self.inspection.gains(recording)

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
        return self.answers.of(climbed, found, i, why, said, given.y.shape[-1] * given.Ts, slopes)

    @property
    def answers(self) -> Answers:
        """What makes results of climbed recordings."""
        further = notes.unfollowed(self.inspection.unexplained)
        further += notes.hidden(self.training.get("hides", ()))
        return Answers(self.plant, self.calibration, self.exact_calibration, self.fallback, further)

    def for_target(self, target: Target, rung: Rung) -> "Tuner":
        """A tuner for another target of the loop, which answers as `rung` did, or from below it.

        A learner knows one target; the fitted plant and the black box serve any, by the design
        rule.

        Raises
        ------
        ValueError
            The plant has one target only.
        """
        alone = rung >= Rung.BLACK_BOX or self.inspection.alone
        method = BlackBoxRule() if alone else Fitted()
        plant = with_target(self.plant, target)
        return Tuner(plant, method, self.training, self.calibration, self.exact_calibration)

    def assess(self, recording: Recording, start: str = "auto") -> tuple[Gains, Assessment]:
        """Gains for every episode as `tune` gives them, and their assessment."""
        climbed, assessment = self.climb(recording, start)
        return climbed.gains, assessment

    def climb(self, recording: Recording, start: str = "auto") -> tuple[Climb, Assessment]:
        """Gains for every episode as `tune` gives them, whose they are, and their assessment."""
        plant, method, seen = self.plant, self.method, self.inspection.look(recording, start)
        known = self.inspection.known(seen.theta)
        climbed = climb(plant, self.rungs, seen.own, seen.fit, seen.response, known)
        climbed = climbed.without(seen.still)
        assessment = assess(
            plant, seen.model, seen.fit, seen.response, seen.used.y, climbed.judged, seen.theta,
            anywhere=method.any_measured, alone=self.inspection.alone,
        )  # fmt: skip
        return climbed, assessment.followed_by(self.inspection.looped(recording))

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
