"""A trained tuner for a plant: recordings to gains, and whether to trust them."""

import os
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tuners import model_file
from tuners.compressors import FirstStage, compressor, described
from tuners.feedforward import FeedForward
from tuners.gbm import GBM
from tuners.laguerre import Laguerre
from tuners.plants import entry
from tuners.plants.black_box import sample
from tuners.plants.plant import Plant
from tuners.plants.trust import Assessment, Limits, assess
from tuners.result import Check, Interval
from tuners.trend import Trend
from tuners.trust import GAUSSIAN
from tuners.two_stage import LEARNERS
from yawrate_env import validation

Array = NDArray[np.float64]

_CANDIDATES = 48


@dataclass(frozen=True, slots=True, eq=False)
class PlantResult:
    """Gains for one recording.

    Attributes
    ----------
    gains : dict
        By name; ``nan`` where the tuner finds none.
    figures : dict
        What the recording says that these gains give, with 90 % intervals.
    trusted : bool
        Whether every check passed.
    reasons, notes : tuple of str
        Why not; and what differs from the experiment that the tuner was trained on.
    fallback : dict
        Gains for every plant of the prior: what to use instead of those not trusted.
    parameters : dict
        Of the plant that explains the recording best.
    checks : tuple of Check
        What was looked at.
    simulated : NDArray
        (N,) that plant's output.
    """

    gains: dict[str, float]
    figures: dict[str, Interval]
    trusted: bool
    reasons: tuple[str, ...]
    notes: tuple[str, ...]
    fallback: dict[str, float]
    parameters: dict[str, float]
    checks: tuple[Check, ...] = field(repr=False)
    simulated: Array = field(repr=False)


class PlantTuner:
    """Compress the recording, predict the gains, ask the simulator beside it.

    Parameters
    ----------
    plant : Plant
        What it was trained for.
    compressor : FirstStage
        First stage.
    learner : FeedForward, GBM or Trend
        Second stage.
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
        compressor: FirstStage,
        learner: FeedForward | GBM | Trend,
        black_box: Laguerre,
        training: dict[str, Any],
        calibration: tuple[float, ...] = (),
    ) -> None:
        self.plant, self.compressor, self.learner = plant, compressor, learner
        self.black_box, self.training = black_box, training
        self.calibration = calibration or (GAUSSIAN,) * len(plant.figures)

    def gains(self, u: Array, y: Array) -> Array:
        """Gains (B, k) for recordings (1, N) or (B, N) and (B, N); ``nan`` where none is found."""
        features, usable = self.compressor(u, y, self.plant.Ts)
        features = np.where(np.isfinite(features), features, 0.0)
        found = self.plant.coordinates.decode(self.learner(features))
        return np.where(usable[:, None], found, np.nan)

    def tune(self, u: ArrayLike, y: ArrayLike, Ts: float | None = None) -> PlantResult:
        """Tune from one recording (N,), (N,), and ask it whether to trust the gains."""
        command = validation.finite_array("u", u, shape=(None,))
        measured = validation.finite_array("y", y, shape=(len(command),))[None]
        self._check_sampling(Ts)
        gains = self.gains(command[None], measured)
        found = self.assess(command, measured, gains)
        checks = found.checks(0, Limits())
        same = np.array_equal(command, self.plant.u)
        return PlantResult(
            self._named(gains[0]),
            self._intervals(found),
            all(check.passed for check in checks),
            tuple(check.message for check in checks if not check.passed),
            () if same else ("The input is not that of the experiment trained on.",),
            self._named(self.fallback),
            dict(zip(self.plant.prior, map(float, found.fit.theta[0]), strict=True)),
            checks,
            found.fit.simulated[0],
        )

    def assess(self, u: Array, y: Array, gains: Array) -> Assessment:
        """What recordings (N,), (B, N) say of gains (B, k)."""
        return assess(self.plant, self.black_box, u, y, gains)

    def predict(
        self,
        obs: ArrayLike,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[Array, Any]:
        """Act as a policy in ``yawrate/Plant-v0``: (2, N) or (B, 2, N) to (k,) or (B, k)."""
        array = np.asarray(obs, dtype=np.float64)
        batch = array if array.ndim == 3 else array[None]
        if batch.ndim != 3 or batch.shape[1:] != (2, len(self.plant.u)):
            raise ValueError(
                f"obs has shape {array.shape}, wanted (2, {len(self.plant.u)}) or a batch of "
                "these, as yawrate/Plant-v0 gives them for this plant."
            )
        gains = self.gains(batch[:, 0], batch[:, 1])
        found = np.isfinite(gains).all(axis=1, keepdims=True)
        usable = np.where(found, gains, self.plant.oracle(self.plant.middle))
        return (usable if array.ndim == 3 else usable[0]), state

    @cached_property
    def fallback(self) -> Array:
        """Gains (k,), right for some plant, that earn most with the plant they suit least."""
        theta = sample(self.plant, _CANDIDATES)
        gains = self.plant.oracle(theta)
        gains = gains[np.isfinite(gains).all(axis=1)]
        each = len(theta)
        pairs = np.repeat(gains, each, axis=0)
        earned = self.plant.reward(np.tile(theta, (len(gains), 1)), pairs)
        return np.asarray(gains[np.argmax(earned.reshape(len(gains), each).min(axis=1))])

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write one file, completely or not at all; the plant itself stays where its entry says."""
        if not self.plant.entry:
            raise ValueError(
                "A saved tuner must find its plant again: give the plant "
                'entry="module:attribute", for example entry="my_plant:plant".'
            )
        settings = {
            "kind": self.kind,
            "entry": self.plant.entry,
            "plant": _settings(self.plant),
            "compressor": described(self.compressor),
            "black_box": described(self.black_box),
            "learner": {kind: name for name, kind in LEARNERS.items()}[type(self.learner)],
            "training": self.training,
            "calibration": list(self.calibration),
        }
        trial = {f"trial.{name}": array for name, array in _trial(self.plant).items()}
        model_file.write(path, settings, {**self.learner.arrays(), **trial})

    def _check_sampling(self, Ts: float | None) -> None:
        if Ts is not None and not np.isclose(Ts, self.plant.Ts, rtol=1e-6):
            raise ValueError(
                f"Ts = {Ts:g} s, but the plant's simulator has {self.plant.Ts:g} s. Resample."
            )

    def _named(self, gains: Array) -> dict[str, float]:
        return dict(zip(self.plant.gains, map(float, gains), strict=True))

    def _intervals(self, found: Assessment) -> dict[str, Interval]:
        half = np.array(self.calibration) * found.spread[0]
        ends = zip(self.plant.figures, found.figures[0], half, strict=True)
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
    try:
        found = plant or entry.find(settings["entry"], Path(path).parent)
    except ValueError as error:
        raise model_file.ModelFileError(f"{path} needs its plant. {error}") from None
    _check_unchanged(path, found, settings["plant"], arrays)
    return PlantTuner(
        found,
        compressor(**settings["compressor"]),
        LEARNERS[settings["learner"]].from_arrays(arrays),
        Laguerre(**{k: v for k, v in settings["black_box"].items() if k != "name"}),
        settings["training"],
        tuple(settings["calibration"]),
    )


def _settings(plant: Plant) -> dict[str, Any]:
    """What can be compared by value, as plain JSON values."""
    return {
        "prior": [[name, *ends] for name, ends in plant.prior.items()],
        "gains": list(plant.gains),
        "Ts": plant.Ts,
        "figures": [[name, scale] for name, scale in plant.figures.items()],
    }


def _trial(plant: Plant) -> dict[str, Array]:
    """What can only be compared by what it answers: to plants that are always the same."""
    theta = sample(plant, 3)
    return {
        "u": plant.u,
        "simulate": plant.respond(theta),
        "noise": plant.sigma(plant.respond(theta)),
        "design": plant.oracle(theta),
        "coordinates": plant.coordinates.encode(plant.oracle(theta)),
        "judge": plant.judged(theta, plant.oracle(plant.middle).repeat(3, axis=0)),
    }


def _check_unchanged(
    path: Any, plant: Plant, settings: dict[str, Any], arrays: dict[str, NDArray[Any]]
) -> None:
    changed = [name for name, value in _settings(plant).items() if settings.get(name) != value]
    if not changed:
        now = _trial(plant)
        changed = [name for name in now if not _same(arrays[f"trial.{name}"], now[name])]
    if changed:  # what comes after the first may be its consequence
        raise model_file.ModelFileError(
            f"{path} was trained for another {plant.entry or 'plant'}: since then its "
            f"{changed[0]} changed. Train again, or restore the description."
        )


def _same(then: Array, now: Array) -> bool:
    """Equal but for what another machine's rounding may do."""
    if then.shape != now.shape:
        return False
    return np.allclose(then, now, rtol=1e-6, atol=1e-9 * np.abs(then).max(), equal_nan=True)
