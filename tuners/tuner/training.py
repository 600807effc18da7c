"""Training and calibration from a plant's description alone."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners import features, learners
from tuners.trust.checks import Assessment
from tuners.trust.emulator import BEYOND, NODES, OF_STEPS, OutputEmulator, nodes_of, probe
from tuners.trust.intervals import conformal
from tuners.tuner.against_bound import EPISODES, Comparison, judge, keep
from tuners.tuner.emulator_check import PLANTS, emulator_shift
from tuners.tuner.examples import Examples, examples
from tuners.tuner.recipes import confined
from tuners.tuner.recording import Recording
from tuners.tuner.simulations import ahead
from tuners.tuner.stages import Recipe, Stages, coordinates_of, train_stages
from tuners.tuner.tuner import Tuner
from yawrate_env import validation
from yawrate_env.plant.calls import call
from yawrate_env.plant.episodes import (
    BLOCK,
    Draw,
    Episodes,
    drawn,
    episodes,
    integers_of,
    prior_gains,
    share_without_gains,
)
from yawrate_env.plant.plant import Plant
from yawrate_env.signals.streams import stream

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]
Improve = Callable[[Tuner, Comparison], tuple[Tuner, Comparison]]

LEAST_PLANTS = 50
LEAST_CALIBRATION = 50

CALIBRATION = 500
"""Episodes that calibrate the intervals by default."""

_TO_FIT = 4  # simulations, about, of a plant to a recording with the help of an emulator
_DOUBTED = 32  # episodes of one doubtful plant
_MEASURED = 0.05  # of its value: by how much a measured parameter is off


def expected(plant: Plant, count: int, calibration: int) -> int:
    """How many simulations the training of a slow plant takes, about."""
    judged = max(calibration, EPISODES) if calibration else 0
    checked = 2 * len(plant.unknown) * PLANTS if calibration else 0
    nodes = BEYOND + (min(OF_STEPS, count) if plant.linear else 0)
    return count + nodes + judged * (1 + _TO_FIT) + checked


def fit(
    plant: Plant,
    recipe: Recipe,
    *,
    count: int | None = None,
    seed: int = 0,
    name: str = "custom",
    data: Examples | None = None,
    progress: Progress | None = None,
) -> tuple[Stages, dict[str, Any]]:
    """Simulate the ``train`` set, find its features, and train the second stage on them.

    Parameters
    ----------
    count : int, optional
        Simulated plants, the recipe's if omitted; 80 % train, the rest validate.
    seed : int
        Of the data and of the learner.
    name : str
        What the recipe is called.
    data : Examples, optional
        Examples already simulated with these features, instead of new ones.
    progress : callable, optional
        Called with the stage's name, how far it is, and how far it goes.

    Returns
    -------
    Stages
    dict
        How they were trained, for the record.
    """
    rehearse(plant, recipe)
    count = recipe.episodes if count is None else count
    count = validation.count("episodes", count, at_least=LEAST_PLANTS, remedy="Simulate more.")
    seed = validation.count("seed", seed, at_least=0)
    recipe = confined(plant, recipe)

    def report(what: str) -> Callable[[int, int], None] | None:
        return None if progress is None else lambda done, of: progress(what, done, of)

    if data is None:
        data = examples(
            plant,
            count,
            seed,
            recipe.features,
            noise_draws=recipe.noise_draws,
            progress=report("simulating"),
        )
    stages, used = train_stages(
        recipe,
        data.number,
        data.features,
        data.targets(coordinates_of(plant, recipe.parametrisation)),
        data.usable,
        seed,
        report(f"training {name}"),
    )
    return stages, {
        "name": name,
        "episodes": int(data.number.max()) + 1,
        "noise_draws": recipe.noise_draws,
        "used": used,
        "seed": seed,
        "set": "train",
    }


def begin(plant: Plant, count: int, calibration: int, seed: int) -> None:
    """Let the workers of a slow plant begin all simulations whose plants are known already.

    They go on while the learner is trained.
    """
    if plant.excite is not None:
        return
    judged = max(calibration, EPISODES) if calibration else 0
    trained = drawn(plant, "train", seed, -(-count // BLOCK) * BLOCK)
    ahead(plant, trained, plant.u)
    ahead(plant, nodes_of(plant, trained[: min(count, NODES)]), probe(plant))
    ahead(plant, drawn(plant, "calibration", seed, -(-judged // BLOCK) * BLOCK), plant.u)


def rehearse(plant: Plant, recipe: Recipe) -> None:
    """``ValueError`` where stages do not work, or could not be saved, before any work."""
    theta = np.repeat(plant.middle, 2, axis=0)
    width = features.rehearse(recipe.features, plant.u[None], plant.respond(theta), plant.Ts)
    coordinates = coordinates_of(plant, recipe.parametrisation)
    targets = coordinates.encode(prior_gains(plant)[:1]).shape[1]
    learners.rehearse(recipe.learner, width + len(plant.measured_names), targets)


def finished(
    plant: Plant,
    stages: Stages,
    training: dict[str, Any],
    calibration: int,
    progress: Progress | None = None,
    improve: Improve | None = None,
) -> Tuner:
    """A tuner of trained stages: judged and calibrated, and with an emulator of a slow plant.

    Parameters
    ----------
    training : dict
        How the stages were trained, which the record keeps and goes on with.
    calibration : int
        Episodes that calibrate the intervals; 0 leaves those of a normal error, and judges nothing.
    improve : callable, optional
        Finds better stages for a tuner that was judged, where it needs any.
    """
    seed = training["seed"]
    if plant.slow and plant.emulator is None:
        nodes = drawn(plant, "train", seed, min(training["episodes"], NODES))
        plant = plant.with_simulator(plant.simulate, OutputEmulator.of(plant, nodes))
    tuner = Tuner(plant, stages, training)
    training["without_gains"] = share_without_gains(plant)
    if calibration:
        found = judge(tuner, seed)
        if improve is not None:
            tuner, found = improve(tuner, found)
        keep(tuner, found)
        calibrate(tuner, calibration, seed, progress)
        if plant.emulator is not None:
            shift = emulator_shift(tuner, seed)
            tuner.training["emulator"] = {
                "nodes": len(plant.emulator.arrays()["nodes"]),
                "shift": shift,
            }
    return tuner


def check_calibration(episodes: int) -> None:
    """``ValueError`` for a number of episodes that calibrates nothing, before any work."""
    if episodes:
        validation.count(
            "calibration", episodes, at_least=LEAST_CALIBRATION, remedy="Simulate more."
        )


def calibrate(tuner: Tuner, episodes: int, seed: int = 0, progress: Progress | None = None) -> None:
    """Set the tuner's calibrations from episodes of the ``calibration`` set.

    The intervals if the plant's data are exact are calibrated on the plant's own episodes, the
    others on those of its `doubtful` plants, if it names any.  Plants that no gains suit ask for
    no interval and are left out; an unstable loop is outside any interval.
    """
    check_calibration(episodes)
    plant, exact, own, done = tuner.plant, [], [], 0
    for block, found, actual in assessed(tuner, "calibration", episodes, seed):
        _, asked = plant.designs(block.theta)
        exact.append(np.stack([found.exact_metrics, found.exact_spread, actual])[:, asked])
        own.append(np.stack([found.metrics, found.spread, actual])[:, asked])
        done += len(block)
        if progress is not None:
            progress("calibrating", done, episodes)
    tuner.exact_calibration = _factors(exact)
    tuner.calibration = _factors(own if plant.doubtful is None else doubted(tuner, episodes, seed))
    tuner.training["calibration"] = {"episodes": episodes, "seed": seed}


def doubted(tuner: Tuner, episodes: int, seed: int) -> list[Array]:
    """Predicted metrics, their spread and actual metrics, (3, B, f) each, of `doubtful` plants.

    Every second block begins in motion, a tenth of the recording late, and measured parameters
    are off by up to `_MEASURED` of their value.
    """
    plant, parts = tuner.plant, []
    assert plant.doubtful is not None
    for number, first in enumerate(range(0, episodes, _DOUBTED)):
        rng = np.random.default_rng((seed, number))
        source, count = call("doubtful", plant.doubtful, rng), min(_DOUBTED, episodes - first)
        drawn = Draw.of(source, stream(seed + 1, number, count, integers_of(source)))
        y = source.measure(drawn.theta, drawn.u, drawn.keys)
        cut = number % 2 * y.shape[1] // 10
        known = drawn.theta[:, : len(plant.prior)].copy()
        for i in plant.indices(plant.measured):
            known[:, i] *= 1 + rng.uniform(-_MEASURED, _MEASURED, count)
        recording = Recording(drawn.u[:, cut:], y[:, cut:], source.Ts, known)
        gains, found = tuner.assess(recording)
        actual = source.metric_values(drawn.theta, gains.values)
        _, asked = source.designs(drawn.theta)
        asked &= found.trusted
        parts.append(np.stack([found.metrics, found.spread, actual])[:, asked])
    return parts


def _factors(parts: list[Array]) -> tuple[float, ...]:
    """Conformal factors (f,) of predictions, spreads and actual metrics, (3, B, f) each."""
    predicted, spread, actual = np.concatenate(parts, axis=1)
    factors = conformal(predicted, spread, actual)
    if not np.isfinite(factors).all():
        lost = np.isnan(predicted + spread + actual).any(axis=1).sum()
        vague = (~np.isfinite(spread) & np.isfinite(actual)).any(axis=1).sum()
        if vague > lost:
            raise ValueError(
                f"{vague} of {len(actual)} recordings that calibrate the intervals leave "
                "parameters of the plant open, at most a tenth may. Give one of those that cannot "
                "be told apart or do not show as a number, or describe another experiment."
            )
        raise ValueError(
            f"{lost} of {len(actual)} loops that calibrate the intervals are unstable or have no "
            "gains or no prediction, at most a tenth may be, of ten or more. Train on more "
            "plants, or narrow the prior."
        )
    return tuple(factors.tolist())


def assessed(
    tuner: Tuner, name: str, count: int, seed: int, plant: Plant | None = None
) -> Iterator[tuple[Episodes, Assessment, Array]]:
    """Tune and assess episodes of a set as `Tuner.tune` does, in bounded memory.

    Parameters
    ----------
    plant : Plant, optional
        Where the episodes come from, if not from the tuner's own plant.

    Yields
    ------
    Episodes
    Assessment
    (B, f) float64
        Counted metrics with the true plants; ``nan`` if unstable.
    """
    source = plant or tuner.plant
    for block in episodes(source, name, seed, 0, count):
        gains, found = tuner.assess(Recording(block.u, block.y, source.Ts, block.theta))
        yield block, found, source.metric_values(block.theta, gains.values)
