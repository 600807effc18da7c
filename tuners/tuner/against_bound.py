"""A trained learner beside the Cramér-Rao bound, and who answers where it is well above it.

A learner that is near the bound answers where the fitted plant confirms its gains.  Any other
answers worse than the design rule does for the fitted plant, and only begins the search for it.

An error that is near the bound on the whole prior may be far above it where recordings tell most:
of a gain between 0.1 and 10 noise hides a hundred times less at one end than at the other.  So the
plants are also looked at in quarters, by their bound.
"""

import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.trust.bound import bounds
from tuners.tuner.method import Rung
from tuners.tuner.recording import Recording
from tuners.tuner.tuner import Tuner
from yawrate_env.plant.episodes import Episodes, episodes
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

EPISODES = 256
"""Of the ``calibration`` set, which measure the learner."""

ENOUGH, TOLD = 1.1, 1.15
"""Times the bound: up to which a learner answers itself, and beyond which the user is told."""

ANYWHERE = 1.2
"""The same as `ENOUGH`, in each quarter of the plants."""

DRAWS = 4
"""Recordings of every plant, with fresh noise, that measure a learner."""

_QUARTERS = 4
_WITHOUT = 0.1  # share of the prior's plants without gains beyond which the user is told


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Errors of gains on B plants that nothing learned from, and the bound.

    Attributes
    ----------
    theta : NDArray
        (B, p) the plants.
    values : NDArray
        (draws, B, f) counted metrics minus those of the right gains.
    bound : NDArray
        (B, f) least standard deviations.
    """

    theta: Array
    values: Array
    bound: Array

    def ratio(self, rows: NDArray[Any] | slice = slice(None)) -> Array:
        """Root mean squares (f,) over those of the bound; 0 where nothing is known."""
        bound = np.broadcast_to(self.bound, self.values.shape)[:, rows]
        errors = self.values[:, rows]
        known = np.isfinite(errors + bound).all(axis=2)
        made, least = (np.square(each[known]).sum(axis=0) for each in (errors, bound))
        return np.asarray(np.sqrt(np.divide(made, least, out=np.zeros_like(made), where=least > 0)))

    @property
    def quarter(self) -> Array:
        """Ratios (f,) of the quarter of the plants, by their bound, where the worst is largest."""
        scale = np.sqrt(np.nanmean(np.square(self.bound), axis=0))
        size = (self.bound / np.where(scale > 0, scale, 1.0)).max(axis=1)
        parts = np.array_split(np.argsort(size, kind="stable"), _QUARTERS)
        return max((self.ratio(part) for part in parts), key=max)

    @property
    def enough(self) -> bool:
        """Whether they are near the bound, on the whole and in every quarter."""
        return bool(self.ratio().max() <= ENOUGH and self.quarter.max() <= ANYWHERE)

    def better_than(self, other: "Errors") -> bool:
        """Whether they are smaller than others that are not `enough`."""
        if other.ratio().max() > ENOUGH:
            return bool(self.ratio().max() < other.ratio().max())
        return bool(self.ratio().max() <= ENOUGH and self.quarter.max() < other.quarter.max())


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """A learner and the fitted plants on the same recordings."""

    own: Errors
    fitted: Errors

    @property
    def refined(self) -> bool:
        """Whether the fitted plants answer instead of the learner."""
        return not self.own.enough and self.fitted.better_than(self.own)

    @property
    def answer(self) -> Errors:
        """Errors of the one that answers."""
        return self.fitted if self.refined else self.own

    def with_learner(self, tuner: Tuner, seed: int) -> "Comparison":
        """The same fitted plants beside another learner."""
        return replace(self, own=learners_errors(tuner, seed))


def judge(tuner: Tuner, seed: int = 0) -> Comparison:
    """Measure learner and fitted plants against the bound."""
    plant, own, errors = tuner.plant, learners_errors(tuner, seed), []
    for block in episodes(plant, "calibration", seed, 0, EPISODES):
        refined = tuner.climb(_recording(plant, block))[0].refined
        errors.append(_missed(plant, block, refined))
    return Comparison(own, replace(own, values=np.concatenate(errors)[None]))


def learners_errors(tuner: Tuner, seed: int) -> Errors:
    """Errors of the tuner's own gains on `DRAWS` recordings of each of `EPISODES` plants."""
    plant, theta, errors, least = tuner.plant, [], [], []
    for draw in range(DRAWS):
        for block in episodes(plant, "calibration", seed, 0, EPISODES, draw):
            gains = tuner.gains(_recording(plant, block)).values
            errors.append(_missed(plant, block, gains))
            if not draw:
                theta.append(block.theta)
                least.append(least_errors(plant, block))
    values = np.concatenate(errors).reshape(DRAWS, EPISODES, -1)
    return Errors(np.concatenate(theta), values, np.concatenate(least))


def least_errors(plant: Plant, block: Episodes) -> Array:
    """The bound (B, f); that of a tuner that knows the prior where a recording tells too little."""
    bound, informed = bounds(plant, block.theta, block.u)
    return np.where(np.isfinite(bound), bound, informed)


def keep(tuner: Tuner, found: Comparison) -> None:
    """Let the better one answer from now on.

    The record keeps ``ratio``, root mean square errors over the bound's by metric, of what
    ``answers``, the name of a `Rung`; and the same of both on the whole and in the worst quarter.
    """
    names = tuner.plant.counted

    def by_metric(values: Array) -> dict[str, float]:
        return dict(zip(names, values.tolist(), strict=True))

    tuner.training["ratio"] = by_metric(found.answer.ratio())
    tuner.training["answers"] = (Rung.FITTED_PLANT if found.refined else Rung.METHOD).name
    tuner.training["against_bound"] = {
        name: {"ratio": by_metric(each.ratio()), "quarter": by_metric(each.quarter)}
        for name, each in (("learner", found.own), ("fitted_plant", found.fitted))
    }


def remarks(tuner: Tuner) -> list[str]:
    """What the training found that its user should know, in sentences."""
    said = []
    without, ratio = tuner.training.get("without_gains", 0.0), tuner.training.get("ratio", {})
    if without > _WITHOUT:
        said.append(
            f"The design rule has no gains that reach its target for {without:.0%} of the prior's "
            "plants, and nothing is learned from these: narrow the prior, or choose another target."
        )
    worst = max(ratio, key=ratio.__getitem__, default="")
    if worst and ratio[worst] > TOLD:
        usual = "simulate more plants (--episodes), excite more strongly, or narrow the prior"
        remedy = tuner.training.get("search", {}).get("remedy", usual)
        said.append(
            f"The error of {worst} is {ratio[worst]:.2f} times the bound, for the learner and for "
            f"the fitted plant: {remedy}."
        )
    return said


def tell(tuner: Tuner) -> None:
    """Warn the caller of a training of what `remarks` has to say."""
    for sentence in remarks(tuner):
        warnings.warn(sentence, stacklevel=3)


def _recording(plant: Plant, block: Episodes) -> Recording:
    return Recording(block.u, block.y, plant.Ts, block.theta)


def _missed(plant: Plant, block: Episodes, gains: Array) -> Array:
    """Counted metrics (B, f) of gains minus those of the design rule's."""
    right = plant.metric_values(block.theta, plant.oracle(block.theta))
    return np.asarray(plant.metric_values(block.theta, gains) - right)
