"""The two-stage method: features of a recording, and a learner that predicts the controller."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from tuners.features import (
    Features,
    check_features,
    features_named,
    settings_of,
    with_measured,
)
from tuners.features.response import FrequencyResponse
from tuners.learners import Learner, Settings, learner_named, name_of, settings_for
from tuners.tuner.method import Gains, Rung
from tuners.tuner.recording import Recording
from yawrate_env import validation
from yawrate_env.plant.parametrisation import GAINS, Parametrisation
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

PARAMETRISATIONS = "plant", "gains"

LEAST_USABLE = 20
TRAINING_SHARE = 0.8

_CLAMPED = 1e-6  # of a coordinate: larger changes by decoding are limits, not rounding


@dataclass(frozen=True, slots=True)
class Recipe:
    """A two-stage tuner before training; every combination is allowed.

    Attributes
    ----------
    features : Features
        First stage: one of `tuners.features`, or a dataclass of one's own.
    learner : Settings
        Second stage: one of `tuners.learners`, a regressor of scikit-learn, or one's own.
    parametrisation : {"plant", "gains"}
        What is predicted: the plant's coordinates, or the gains themselves.
    noise_draws : int
        Recordings of every simulated plant, with fresh noise.
    episodes : int
        Simulated plants that it is usually trained on.
    components : int
        Principal components of simulated plants that a `FrequencyResponse` is confined to; with 0
        it is not.
    """

    features: Features
    learner: Settings
    parametrisation: str = "plant"
    noise_draws: int = 1
    episodes: int = 1500
    components: int = 0

    def __post_init__(self) -> None:
        validation.one_of("parametrisation", self.parametrisation, PARAMETRISATIONS)
        validation.count("noise_draws", self.noise_draws, remedy="Record every plant once or more.")
        validation.count("episodes", self.episodes, remedy="Simulate some.")
        validation.count("components", self.components, at_least=0, remedy="0 is for none.")
        check_features(self.features)
        if self.components:
            remedy = "Other features have no components: leave them out."
            validation.instance("features", self.features, FrequencyResponse, remedy=remedy)
        object.__setattr__(self, "learner", settings_for(self.learner))


def coordinates_of(plant: Plant, parametrisation: str) -> Parametrisation:
    """The plant's coordinates, or those of the gains themselves."""
    return plant.parametrisation if parametrisation == "plant" else GAINS


@dataclass(frozen=True, slots=True)
class Stages:
    """Both stages, trained: the method that finds gains from features.

    Attributes
    ----------
    features : Features
        First stage.
    learner : Learner
        Second stage.
    parametrisation : {"plant", "gains"}
        What the learner predicts.
    """

    features: Features
    learner: Learner
    parametrisation: str = "plant"

    kind: ClassVar[str] = "two-stage"
    needs_excitation: ClassVar[bool] = True
    any_measured: ClassVar[bool] = False
    rungs: ClassVar[tuple[Rung, ...]] = (Rung.METHOD, Rung.FITTED_PLANT, Rung.BLACK_BOX)

    @property
    def any_experiment(self) -> bool:
        """Whether its features depend neither on the input nor on the sampling time."""
        return self.features.any_experiment

    def predict(
        self, u: Array, y: Array, Ts: float, measured: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Predict coordinates from recordings.

        Parameters
        ----------
        u : (1, N) or (B, N) float64
            Inputs.
        y : (B, N) float64
            Measured outputs.
        Ts : float
            Sampling time [s].
        measured : (B, m) float64
            Further features: `Plant.measured_features`.

        Returns
        -------
        (B, t) float64
            Coordinates of the controller; ``nan`` where a feature is not a number.
        (B,) bool
            Where the first stage succeeded.
        """
        features, usable = with_measured(self.features, u, y, Ts, measured)
        finite = np.isfinite(features)
        values = self.learner(np.where(finite, features, 0.0))
        known = np.asarray(finite.all(axis=1))
        return np.where(known[:, None], values, np.nan), usable & known

    def gains(self, plant: Plant, recording: Recording) -> Gains:
        """Features, prediction, gains."""
        measured = np.empty((len(recording), 0))
        if plant.measured_names:
            measured = plant.measured_features(recording.parameters(plant))
        values, usable = self.predict(recording.u, recording.y, recording.Ts, measured)
        coordinates = coordinates_of(plant, self.parametrisation)
        gains = coordinates.decode(values)
        with np.errstate(invalid="ignore"):
            clamped = np.abs(coordinates.encode(gains) - values) > _CLAMPED * (1 + np.abs(values))
        return Gains.of(gains, np.asarray(~clamped.any(axis=1)), usable)

    def settings(self) -> dict[str, Any]:
        """What to save beside the learner's arrays, as plain JSON values."""
        return {
            "features": settings_of(self.features),
            "learner": name_of(self.learner),
            "parametrisation": self.parametrisation,
        }

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The learner's."""
        return self.learner.arrays()

    @classmethod
    def from_file(cls, settings: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> Self:
        """Rebuild from what was saved, or ``ValueError`` where the stages do not go together."""
        features = features_named(**settings["features"])
        learner = learner_named(settings["learner"], arrays)
        width = getattr(features, "width", 0)  # a stage of one's own need not say
        if width > learner.width:
            raise ValueError(f"{width} features are more than the learner's {learner.width}.")
        return cls(
            features,
            learner,
            validation.one_of("parametrisation", settings["parametrisation"], PARAMETRISATIONS),
        )


def train_stages(
    recipe: Recipe,
    number: NDArray[np.int64],
    features: Array,
    targets: Array,
    usable: NDArray[np.bool_],
    seed: int,
    progress: Progress | None = None,
) -> tuple[Stages, int]:
    """Train the second stage on the features of simulated recordings.

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
    part = training_split(number.max() + 1, seed)
    own, others = (rows[p[number[rows]]] for p in (part, ~part))
    training, validating = ([(features[r], targets[r])] for r in (own, others))
    learner = recipe.learner.fit(training, validating, seed, progress)
    return Stages(recipe.features, learner, recipe.parametrisation), len(rows)


def check_usable(usable: int, episodes: int) -> None:
    """``ValueError`` where too few episodes have features and gains to learn from."""
    if usable < LEAST_USABLE:
        raise ValueError(
            f"{usable} of {episodes} episodes are usable, at least {LEAST_USABLE} are needed. "
            "Choose a target that the controller can reach, or simulate more."
        )


def training_split(plants: int, seed: int) -> NDArray[np.bool_]:
    """(plants,) which of them train; the rest validate."""
    order = np.random.default_rng(seed).permutation(plants)
    chosen = np.zeros(plants, dtype=np.bool_)
    chosen[order[: round(TRAINING_SHARE * plants)]] = True
    return chosen
