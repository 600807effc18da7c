"""A trained learner beside the Cramér-Rao bound, and who answers where it is well above it.

A learner that is near the bound answers where the fitted plant confirms its gains.  Any other
answers worse than the design rule does for the fitted plant, and only begins the search for it.
"""

import warnings

import numpy as np
from numpy.typing import NDArray

from tuners.trust.bound import bounds
from tuners.tuner.method import Rung
from tuners.tuner.recording import Recording
from tuners.tuner.tuner import Tuner
from yawrate_env.plant.episodes import episodes

Array = NDArray[np.float64]

EPISODES = 256
"""Of the ``calibration`` set, which measure the learner."""

ENOUGH, TOLD = 1.1, 1.15
"""Times the bound: up to which a learner answers itself, and beyond which the user is told."""

_WITHOUT = 0.1  # share of the prior's plants without gains beyond which the user is told


def judge(tuner: Tuner, seed: int = 0) -> None:
    """Measure learner and fitted plants against the bound; the better answers from now on.

    The record keeps ``ratio``, root mean square errors over the bound's by metric, of what
    ``answers``, the name of a `Rung`.
    """
    plant, errors, least = tuner.plant, [], []
    for block in episodes(plant, "calibration", seed, 0, EPISODES):
        recording = Recording(block.u, block.y, plant.Ts, block.theta)
        right = plant.metric_values(block.theta, plant.oracle(block.theta))
        answers = tuner.gains(recording).values, tuner.climb(recording)[0].refined
        errors.append([plant.metric_values(block.theta, gains) - right for gains in answers])
        least.append(bounds(plant, block.theta, block.u))
    bound, informed = (np.concatenate(each) for each in zip(*least, strict=True))
    bound = np.where(np.isfinite(bound), bound, informed)
    own, fitted = (_ratio(np.concatenate(each), bound) for each in zip(*errors, strict=True))
    refined = own.max() > ENOUGH and fitted.max() < own.max()
    ratio = fitted if refined else own
    tuner.training["ratio"] = dict(zip(plant.counted, ratio.tolist(), strict=True))
    tuner.training["answers"] = (Rung.FITTED_PLANT if refined else Rung.METHOD).name


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
        said.append(
            f"The error of {worst} is {ratio[worst]:.2f} times the bound, for the learner and for "
            "the fitted plant: simulate more plants (--episodes), excite more strongly, or narrow "
            "the prior."
        )
    return said


def tell(tuner: Tuner) -> None:
    """Warn the caller of a training of what `remarks` has to say."""
    for sentence in remarks(tuner):
        warnings.warn(sentence, stacklevel=3)


def _ratio(errors: Array, bound: Array) -> Array:
    """Root mean squares (f,) of errors (B, f) over those of the bound; 0 where nothing is known."""
    known = np.isfinite(errors + bound).all(axis=1)
    made, least = (np.square(each[known]).sum(axis=0) for each in (errors, bound))
    return np.asarray(np.sqrt(np.divide(made, least, out=np.zeros_like(made), where=least > 0)))
