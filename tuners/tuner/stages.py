"""The two stages: compress a recording, then predict its controller; how they are trained."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tuners.features import FirstStage, check, compressor, described
from tuners.learners import LEARNERS, Learner, Settings
from yawrate_env import validation

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

LEAST_USABLE = 20
TRAINING_SHARE = 0.8


@dataclass(frozen=True, slots=True)
class Recipe:
    """A two-stage tuner before training; every combination is allowed.

    Attributes
    ----------
    compressor : Armax, Laguerre, Regularised or FrequencyResponse
        First stage.
    learner : GBMSettings, FeedForwardSettings or TrendSettings
        Second stage.
    coordinates : {"loop", "gains"}
        What is predicted for vehicles; other plants have coordinates of their own.
    noise_draws : int
        Recordings of every simulated plant, with fresh noise.
    vehicles : int
        Simulated plants that it is usually trained on.
    v_x : tuple of float
        Speeds that it is usually trained for [m/s]; a range makes the speed a feature.
    """

    compressor: FirstStage
    learner: Settings
    coordinates: str = "loop"
    noise_draws: int = 1
    vehicles: int = 1500
    v_x: tuple[float, float] = (20.0, 20.0)

    def __post_init__(self) -> None:
        validation.count("noise_draws", self.noise_draws, remedy="Record every plant once or more.")
        validation.count("vehicles", self.vehicles, remedy="Simulate some.")
        check(self.compressor)


def checked(recipe: Recipe) -> Recipe:
    """The recipe itself, or ``ValueError``."""
    remedy = "Give a tuners.Recipe, or one of tuners.RECIPES."
    validation.instance("recipe", recipe, Recipe, remedy=remedy)
    return recipe


@dataclass(frozen=True, slots=True)
class Stages:
    """Both stages, trained.

    Attributes
    ----------
    compressor : Armax, Laguerre, Regularised or FrequencyResponse
        First stage.
    learner : FeedForward, GBM, Trend or Agent
        Second stage.
    """

    compressor: FirstStage
    learner: Learner

    def __call__(
        self, u: Array, y: Array, Ts: float, shown: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Predict from recordings.

        Parameters
        ----------
        u : (1, N) or (B, N) float64
            Inputs.
        y : (B, N) float64
            Measured outputs.
        Ts : float
            Sampling time [s].
        shown : (B, m) float64
            Further features, from what is measured beside the recording.

        Returns
        -------
        (B, t) float64
            What the learner was trained on, `tuners.tuner.coordinates` say.
        (B,) bool
            Where the compression succeeded, and every feature is a number.
        """
        features, usable = self.compressor(u, y, Ts)
        features = np.concatenate([features, shown], axis=1)
        finite = np.isfinite(features)
        return self.learner(np.where(finite, features, 0.0)), usable & finite.all(axis=1)

    def settings(self) -> dict[str, Any]:
        """What to save beside the learner's arrays, as plain JSON values."""
        kinds = {kind: name for name, kind in LEARNERS.items()}
        return {
            "compressor": described(self.compressor),
            "learner": kinds[type(self.learner)],
        }

    @classmethod
    def from_file(cls, settings: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> Self:
        """Rebuild from what was saved."""
        return cls(
            compressor(**settings["compressor"]),
            LEARNERS[settings["learner"]].from_arrays(arrays),
        )


def trained(
    recipe: Recipe,
    number: NDArray[np.int64],
    features: Array,
    targets: Array,
    usable: NDArray[np.bool_],
    seed: int,
    progress: Progress | None = None,
) -> tuple[Stages, int]:
    """Train the second stage on what the first made of simulated recordings.

    Parameters
    ----------
    number : (m,) int
        Which plant a row is of; all rows of one train, or all validate.
    features : (m, n) float64
    targets : (m, t) float64
    usable : (m,) bool
        Rows to learn from.
    seed : int
        Of the split and the learner.

    Returns
    -------
    Stages
    int
        Rows used.
    """
    rows = np.flatnonzero(usable)
    check_usable(len(rows), len(usable))
    part = trains(number.max() + 1, seed)
    own, checked = (rows[p[number[rows]]] for p in (part, ~part))
    learner = recipe.learner.fit(
        features[own], targets[own], features[checked], targets[checked], seed, progress
    )
    return Stages(recipe.compressor, learner), len(rows)


def check_usable(usable: int, episodes: int) -> None:
    """``ValueError`` where too few episodes have features and gains to learn from."""
    if usable < LEAST_USABLE:
        raise ValueError(
            f"{usable} of {episodes} episodes are usable, at least {LEAST_USABLE} are needed. "
            "Choose a target that the controller can reach, or simulate more."
        )


def trains(plants: int, seed: int) -> NDArray[np.bool_]:
    """(plants,) which of them train; the rest validate."""
    order = np.random.default_rng(seed).permutation(plants)
    chosen = np.zeros(plants, dtype=np.bool_)
    chosen[order[: round(TRAINING_SHARE * plants)]] = True
    return chosen
