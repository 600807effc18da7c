"""A plant's tuner beside its rivals, on the same episodes and by the same judge."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.trust.bound import cramer_rao
from tuners.trust.identification import identify, identify_from_several
from tuners.tuner.plant_tuner import PlantTuner
from yawrate_env.batch import concatenate
from yawrate_env.plant.episodes import Episodes, episodes

Array = NDArray[np.float64]

TUNER, GRAY_BOX, SEVERAL = "two-stage", "gray box", "gray box, 5 starts"
NOMINAL, ORACLE = "nominal", "oracle"


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """E test episodes.

    Attributes
    ----------
    errors : dict
        Name to (E, f) figures' distances from what the design rule reaches; ``nan`` where
        unstable.
    bound : NDArray
        (E, f) least standard deviations.
    trusted, converged : NDArray
        (E,) whether the two-stage gains were trusted; whether the gray box converged.
    covered : NDArray
        (E, f) whether the two-stage tuner's 90 % intervals held.
    """

    errors: dict[str, Array]
    bound: Array
    trusted: NDArray[np.bool_]
    converged: NDArray[np.bool_]
    covered: NDArray[np.bool_]

    def rms(self, name: str) -> Array:
        """Root mean square errors (f,) over the stable loops."""
        return np.asarray(np.sqrt(np.nanmean(self.errors[name] ** 2, axis=0)))

    def unstable(self, name: str) -> int:
        """Loops that are unstable or have no gains."""
        return int(np.isnan(self.errors[name]).any(axis=1).sum())


@dataclass(frozen=True, slots=True, eq=False)
class _Block:
    tuner: Array
    gray_box: Array
    several: Array
    nominal: Array
    bound: Array
    trusted: NDArray[np.bool_]
    converged: NDArray[np.bool_]
    covered: NDArray[np.bool_]


def compare(tuner: PlantTuner, count: int, seed: int) -> Comparison:
    """Tune the first `count` episodes of the ``test`` set with everything there is.

    The gray box is the plant's own simulator, fitted within the prior from its middle, or
    from several places.
    """
    blocks = episodes(tuner.plant, "test", seed, 0, count)
    rows = concatenate([_judged(tuner, block) for block in blocks])
    errors = {
        TUNER: rows.tuner,
        GRAY_BOX: rows.gray_box,
        SEVERAL: rows.several,
        NOMINAL: rows.nominal,
        ORACLE: np.where(np.isnan(rows.bound), np.nan, 0.0),
    }
    return Comparison(errors, rows.bound, rows.trusted, rows.converged, rows.covered)


def _judged(tuner: PlantTuner, block: Episodes) -> _Block:
    plant, theta = tuner.plant, block.theta
    gains, found = tuner.assess(block.u, block.y, theta)
    start = theta.copy()
    start[:, plant.unknown] = plant.middle[:, plant.unknown]
    gray_box = identify(plant, block.u, block.y, start)
    several = identify_from_several(plant, block.u, block.y, start)
    nominal = np.tile(plant.middle, (len(theta), 1))
    actual, right = (
        plant.metric_values(theta, gains),
        plant.metric_values(theta, plant.oracle(theta)),
    )
    with np.errstate(invalid="ignore"):
        return _Block(
            actual - right,
            plant.metric_values(theta, plant.oracle(gray_box.theta)) - right,
            plant.metric_values(theta, plant.oracle(several.theta)) - right,
            plant.metric_values(theta, plant.oracle(nominal)) - right,
            cramer_rao(plant, theta, block.u),
            found.trusted,
            gray_box.converged,
            np.abs(actual - found.metrics) <= np.array(tuner.calibration) * found.spread,
        )
