"""Training sets that contain each other, simulated once."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from tuners import Recipe, Tuner, train
from tuners.features import Features
from tuners.tuner.examples import Examples, examples_of
from yawrate_env.batch import concatenate, take
from yawrate_env.plant.plant import Plant

Progress = Callable[[int, int], None]

TRAINING_SEED = 0

ROWS = 40_000
"""Fresh noise on the same vehicles stops here: beyond it another vehicle teaches as much."""


def noise_draws(recipe: Recipe, vehicles: int) -> int:
    """The recipe's own, fewer where there are many vehicles, 1 at least."""
    return max(min(recipe.noise_draws, ROWS // vehicles), 1)


def simulate(
    plant: Plant,
    features: Features,
    draws: Mapping[int, int],
    progress: Progress | None = None,
) -> list[Examples]:
    """Data of the ``train`` set, one part a noise draw, enough for all the sizes.

    Parameters
    ----------
    draws : mapping
        Numbers of vehicles, and the noise draws for each.
    """
    counts = [max(m for m, d in draws.items() if d > r) for r in range(max(draws.values()))]
    parts, done = [], 0
    for repeat, count in enumerate(counts):
        blocks = []
        for rows, _ in examples_of(plant, "train", TRAINING_SEED, 0, count, features, repeat):
            blocks.append(rows)
            done += len(rows)
            if progress is not None:
                progress(done, sum(counts))
        parts.append(concatenate(blocks))
    return parts


def first(parts: list[Examples], vehicles: int, draws: int) -> Examples:
    """The data that `train` would simulate for so many vehicles and noise draws."""
    return concatenate([take(part, slice(0, vehicles)) for part in parts[:draws]])


def trained(
    recipe: Recipe,
    plant: Plant,
    parts: list[Examples],
    vehicles: int,
    draws: int,
    progress: Callable[[str, int, int], None] | None = None,
) -> Tuner:
    """Train a recipe on the first `vehicles` of the data, without calibrated intervals."""
    return train(
        replace(recipe, noise_draws=draws),
        plant,
        episodes=vehicles,
        seed=TRAINING_SEED,
        calibration=0,
        data=first(parts, vehicles, draws),
        progress=progress,
    )
