"""A trained tuner for a plant: recordings to gains, and whether to trust them."""

import os
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tuners.features import described
from tuners.features.laguerre import Laguerre
from tuners.trust.black_box import black_box
from tuners.trust.checks import GAUSSIAN, Assessment, Finding, assess
from tuners.tuner import tuner_file as model_file
from tuners.tuner.plant_result import PlantFit, PlantResult
from tuners.tuner.recording import Recording
from tuners.tuner.result import Interval
from tuners.tuner.stages import Stages
from yawrate_env import validation
from yawrate_env.env.plant_env import recordings
from yawrate_env.plant import entry, fingerprint
from yawrate_env.plant.episodes import sample
from yawrate_env.plant.plant import Plant
from yawrate_env.plant.reward import UNSTABLE

Array = NDArray[np.float64]

_CANDIDATES = 48
_SLOWEST = 0.1  # sampling time, in periods of the crossover
_COARSEST = 10.0  # sampling time, in those of the experiment, where there is no crossover
_TRIAL = "trial."  # begins the names of arrays that are the plant's answers
_LONGEST = 200_000  # samples of one recording
_BENT = 0.01  # of the output's standard deviation: what a spline may miss between samples
_TOO_SLOW = "Between the log's samples the output bends more than a curve shows: record faster."
_ROUNDED = 1e-3  # of the largest input, or of a sampling time: as logs write it


def slowest(plant: Plant) -> float:
    """Longest sampling time that still shows what a plant does [s]."""
    return _COARSEST * plant.Ts if plant.crossover is None else _SLOWEST / plant.crossover


def _between(given: Recording, found: Assessment) -> Array:
    """What a spline through a slow log's samples misses of the fitted plant's output, relative."""
    simulated, Ts = found.fit.simulated[0], found.model.Ts
    times = Ts * np.arange(len(simulated))
    seen = np.interp(given.Ts * np.arange(given.y.shape[1]), times, simulated)
    drawn = replace(given, y=seen[None]).resampled(Ts).y[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        missed = np.mean((drawn - simulated[: len(drawn)]) ** 2) / simulated.var()
    return np.array([np.sqrt(missed)])


class PlantTuner:
    """Compress the recording, predict the gains, ask the simulator beside it.

    Parameters
    ----------
    plant : Plant
        What it was trained for.
    stages : Stages
        Both, trained.
    black_box : Laguerre
        What the simulator is compared with.
    training : dict
        How it was trained, kept for the record.
    calibration : tuple of float
        Half widths of the figures' intervals in standard deviations; those of a normal
        error if nothing was calibrated.
    """

    kind: ClassVar[str] = "plant"

    def __init__(
        self,
        plant: Plant,
        stages: Stages,
        black_box: Laguerre,
        training: dict[str, Any],
        calibration: tuple[float, ...] = (),
    ) -> None:
        self.plant, self.stages = plant, stages
        self.black_box, self.training = black_box, training
        self.calibration = calibration or (GAUSSIAN,) * len(plant.metrics)

    def __repr__(self) -> str:
        what = self.plant.entry or ", ".join(self.plant.prior)
        return f"<PlantTuner {what}>"

    def gains(self, u: Array, y: Array, theta: Array | None = None) -> Array:
        """Gains (B, k) for inputs (N,), (1, N) or (B, N) and outputs (B, N); ``nan`` where none is.

        Parameters
        ----------
        theta : (B, p) float64, optional
            Parameters of which those that are measured are looked at.
        """
        u, beside = np.atleast_2d(u), self._middle(len(y)) if theta is None else theta
        values, usable = self.stages(u, y, self.plant.Ts, self.plant.measured_features(beside))
        return np.where(usable[:, None], self.plant.parametrisation.decode(values), np.nan)

    def tune(
        self,
        u: ArrayLike,
        y: ArrayLike,
        Ts: float | None = None,
        measured: Mapping[str, float] | None = None,
        start: str = "auto",
    ) -> PlantResult:
        """Tune from one recording (N,), (N,), and ask it whether to trust the gains.

        Parameters
        ----------
        Ts : float, optional
            Sampling time [s]; where it is not the plant's, the input is held and the output
            follows a cubic spline.
        measured : dict, optional
            Parameters that the plant calls measured to their values.
        start : {"auto", "rest", "unknown"}
            Whether the recording starts from rest without offsets, or start and offsets are
            estimated along; found from the data if not given.  Where responses do not add
            up the data cannot say, and rest is meant.
        """
        theta = self._beside(measured or {})
        given = self._recording(u, y, Ts)
        used = given.resampled(self.plant.Ts)
        gains, found = self.assess(used.u, used.y, theta, start, used.oversampled)
        if given.Ts > self.plant.Ts * (1 + _ROUNDED):
            found = found.beside(between=Finding(_between(given, found), _BENT, _TOO_SLOW))
        checks = found.checks(0)
        return PlantResult(
            self._named(gains[0]),
            self._intervals(found),
            all(check.passed for check in checks),
            tuple(dict.fromkeys(check.message for check in checks if not check.passed)),
            self._differences(given, used),
            self._named(self.fallback),
            checks,
            PlantFit.of(self.plant, found),
            self.plant,
        )

    def assess(
        self,
        u: Array,
        y: Array,
        theta: Array | None = None,
        start: str = "auto",
        oversampled: float = 1.0,
    ) -> tuple[Array, Assessment]:
        """Gains (B, k) as `tune` gives them, and what recordings at the plant's `Ts` say of them.

        Parameters
        ----------
        theta : (B, p) float64, optional
            Parameters of which those that are measured are looked at.
        oversampled : float
            Samples for each independent one: above 1 where samples were interpolated.
        """
        u, beside = np.atleast_2d(u), self._middle(len(y)) if theta is None else theta
        model = black_box(self.plant, self.black_box, u, y, start, oversampled)
        gains = self.gains(u, model.y, beside)
        solved = np.asarray(np.isfinite(gains).all(axis=1))
        begin = self._middle(len(y))
        begin[:, self.plant.known] = beside[:, self.plant.known]
        found = assess(self.plant, model, y, gains, begin, solved)
        return gains, found.beside(**self._of_measured(begin))

    def predict(
        self,
        obs: ArrayLike,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[Array, Any]:
        """Act as a policy in ``yawrate/Plant-v0``: (rows, N) or (B, rows, N) to (k,) or (B, k)."""
        u, y, theta, single = recordings(self.plant, obs)
        if not len(y):
            return np.empty((0, len(self.plant.gains))), state
        gains = self.gains(u, y, theta)
        found = np.isfinite(gains).all(axis=1, keepdims=True)
        middle = self.plant.oracle(self.plant.middle)[0]
        usable = np.where(found, gains, middle if np.isfinite(middle).all() else self.fallback)
        return (usable[0] if single else usable), state

    @cached_property
    def fallback(self) -> Array:
        """Gains (k,), right for some plant, that earn most with the plant they suit least.

        ``nan`` where every such plant makes some other one unstable.
        """
        theta = sample(self.plant, _CANDIDATES)
        gains = self.plant.oracle(theta)
        right = np.isfinite(gains).all(axis=1)  # what no gains suit asks for none
        theta, gains = theta[right], gains[right]
        if not len(theta):
            return np.full(len(self.plant.gains), np.nan)
        each = len(theta)
        pairs = np.repeat(gains, each, axis=0)
        earned = self.plant.reward(np.tile(theta, (len(gains), 1)), pairs)
        least = earned.reshape(len(gains), each).min(axis=1)
        if not (least > UNSTABLE).any():
            return np.full(len(self.plant.gains), np.nan)
        return np.asarray(gains[np.argmax(least)])

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write one file, completely or not at all; the plant itself stays where its entry says."""
        settings = {
            "kind": self.kind,
            "entry": entry.named(self.plant, "A saved tuner"),
            "plant": fingerprint.settings(self.plant),
            **self.stages.settings(),
            "black_box": described(self.black_box),
            "training": self.training,
            "calibration": list(self.calibration),
        }
        trial = {f"{_TRIAL}{name}": array for name, array in fingerprint.trial(self.plant).items()}
        model_file.write(path, settings, {**self.stages.learner.arrays(), **trial})

    def _middle(self, count: int) -> Array:
        return np.tile(self.plant.middle, (count, 1))

    def _beside(self, measured: Mapping[str, float]) -> Array:
        """Parameters (1, p) with the measured ones in their places."""
        theta = self._middle(1)
        for name, value in measured.items():
            if not self.plant.measured:
                raise ValueError(f"measured {name!r}: nothing is measured beside this plant.")
            validation.one_of("measured parameter", name, tuple(self.plant.measured))
            theta[0, self.plant.indices((name,))] = self.plant.check_value(name, value)
        for name in self.plant.measured:
            low, high = self.plant.prior[name]
            if name not in measured and low < high:
                raise ValueError(
                    f"{name} is needed: this tuner covers {low:g} to {high:g}. Give what was "
                    f'measured beside the recording, as in measured={{"{name}": {high:g}}}.'
                )
        return theta

    def _of_measured(self, theta: Array) -> dict[str, Finding]:
        """How far measured parameters lie outside what the tuner was made for."""
        found = {}
        for i, (name, (low, high)) in enumerate(self.plant.prior.items()):
            if name in self.plant.measured:
                beyond = np.maximum(np.maximum(low - theta[:, i], theta[:, i] - high), 0.0)
                message = f"{name} is not within what the tuner was made for: {low:g} to {high:g}."
                found[name] = Finding(beyond, self.plant.measured[name], message)
        return found

    def _recording(self, u: ArrayLike, y: ArrayLike, Ts: float | None) -> Recording:
        """One recording as it was made, checked."""
        command = validation.finite_array("u", u, shape=(None,))[None]
        output = validation.finite_array("y", y, shape=(command.shape[1],))[None]
        Ts = self.plant.Ts if Ts is None else Ts
        validation.number("Ts", Ts, above=0.0, at_most=slowest(self.plant), remedy="Slower "
                          "samples do not show what the plant does: record faster.")  # fmt: skip
        samples = output.shape[1] * Ts / self.plant.Ts
        validation.number("number of samples at the plant's Ts", samples, at_most=_LONGEST,
                          remedy="Cut to the best part.")  # fmt: skip
        return Recording(command, output, float(Ts))

    def _differences(self, given: Recording, used: Recording) -> tuple[str, ...]:
        """Between a recording and the experiment trained on, in words."""
        plant, u, notes = self.plant, used.u[0], []
        if not np.isclose(given.Ts, plant.Ts, rtol=_ROUNDED):
            notes.append(f"Ts is {given.Ts:g} s: resampled to the plant's {plant.Ts:g} s.")
        rounding = _ROUNDED * np.abs(plant.u).max()
        same = u.shape == plant.u.shape and np.allclose(u, plant.u, rtol=0, atol=rounding)
        if plant.excite is None and not same:
            notes.append("The input is not that of the experiment trained on.")
        return tuple(notes)

    def _named(self, gains: Array) -> dict[str, float]:
        return dict(zip(self.plant.gains, map(float, gains), strict=True))

    def _intervals(self, found: Assessment) -> dict[str, Interval]:
        half = np.array(self.calibration) * found.spread[0]
        ends = zip(self.plant.metrics, found.metrics[0], half, strict=True)
        return {
            name: Interval(float(value), float(value - h), float(value + h))
            for name, value, h in ends
        }


def load(path: str | os.PathLike[str], plant: Plant | None = None) -> PlantTuner:
    """Read a tuner that `PlantTuner.save` wrote.

    Parameters
    ----------
    plant : Plant, optional
        Its plant, if not to be imported from the entry point that the file names; look
        at it first where the file comes from somebody else: importing runs code.

    Raises
    ------
    ValueError
        The file is unusable, or the plant is missing or has changed.
    """
    settings, arrays = model_file.read(path)
    if settings.get("kind") != PlantTuner.kind:
        raise model_file.ModelFileError(f"{path} is no plant's tuner. Use tuners.load.")
    with model_file.rebuilding(path):
        return _rebuilt(path, settings, arrays, plant)


def _rebuilt(
    path: str | os.PathLike[str],
    settings: dict[str, Any],
    arrays: dict[str, NDArray[Any]],
    plant: Plant | None,
) -> PlantTuner:
    """The tuner of a file's contents, which is tried once."""
    try:
        found = plant or entry.find(settings["entry"], Path(path).parent)
    except ValueError as error:
        raise model_file.ModelFileError(f"{path} needs its plant. {error}") from None
    answers = {n.removeprefix(_TRIAL): a for n, a in arrays.items() if n.startswith(_TRIAL)}
    learned = {name: array for name, array in arrays.items() if not name.startswith(_TRIAL)}
    if other := fingerprint.changed(found, settings["plant"], answers):
        raise model_file.ModelFileError(
            f"{path} was trained for another {found.entry or 'plant'}: since then its {other} "
            "changed. Train again, or restore the description."
        )
    factors = validation.finite_array(
        "calibration", settings["calibration"], shape=(len(found.metrics),)
    )
    if (factors < 0).any():
        raise ValueError(f"calibration has {factors.min():g}, which is no width.")
    validation.instance("training", settings["training"], dict, remedy="")
    tuner = PlantTuner(
        found,
        Stages.from_file(settings, learned),
        Laguerre(**{k: v for k, v in settings["black_box"].items() if k != "name"}),
        settings["training"],
        tuple(factors.tolist()),
    )
    answered = tuner.gains(found.u, found.respond(found.middle)).shape
    if answered != (1, len(found.gains)):
        raise ValueError(f"it answers {answered[1]} gains, wanted {len(found.gains)}.")
    return tuner
