"""Compare a tuner with the gray box, the nominal gains, the oracle and the Cramér-Rao bound."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.trust.bound import bounds
from tuners.trust.identification import Identified, identify, identify_from_several
from tuners.trust.verdict import Verdict
from tuners.tuner.evaluation import pieces
from tuners.tuner.recording import Recording
from tuners.tuner.tuner import Tuner
from yawrate_env.batch import concatenate
from yawrate_env.plant.episodes import BLOCK, Episodes

Array = NDArray[np.float64]

TUNER, GRAY_BOX, SEVERAL = "two-stage", "gray box", "gray box, 5 starts"
NOMINAL, ORACLE = "nominal", "oracle"


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """A trained tuner beside reference tuners on E test episodes.

    Attributes
    ----------
    errors : dict
        Name to (E, f) metrics' distances from what the design rule reaches; ``nan`` where
        unstable.
    bound : NDArray
        (E, f) least standard deviations.
    informed : NDArray
        (E, f) the same of a tuner that knows the prior too.
    verdicts : NDArray
        (E,) on the tuner's gains: 0 usable, 1 with care, 2 refused.
    converged : NDArray
        (E,) whether the gray box converged.
    covered : NDArray
        (E, f) whether the tuner's 90 % intervals held.
    """

    errors: dict[str, Array]
    bound: Array
    informed: Array
    verdicts: NDArray[np.int64]
    converged: NDArray[np.bool_]
    covered: NDArray[np.bool_]

    @property
    def trusted(self) -> NDArray[np.bool_]:
        """Whether the tuner's gains were usable, with care or without, (E,)."""
        return np.asarray(self.verdicts < len(Verdict) - 1)

    def rms(self, name: str) -> Array:
        """Root mean square errors (f,) over the stable loops."""
        return np.asarray(np.sqrt(np.nanmean(self.errors[name] ** 2, axis=0)))

    def unstable(self, name: str) -> int:
        """Loops that are unstable or have no gains."""
        return int(np.isnan(self.errors[name]).any(axis=1).sum())


@dataclass(frozen=True, slots=True, eq=False)
class _Compared:
    tuner: Array
    gray_box: Array
    several: Array
    nominal: Array
    bound: Array
    informed: Array
    verdicts: NDArray[np.int64]
    converged: NDArray[np.bool_]
    covered: NDArray[np.bool_]


def compare(tuner: Tuner, count: int, seed: int, *, gray_box: bool = True) -> Comparison:
    """Tune the first `count` episodes of the ``test`` set with the tuner and its references.

    Parameters
    ----------
    gray_box : bool
        Whether the plant's own simulator is among these, fitted within the prior from its middle,
        and from several points.
    """
    blocks = pieces(tuner.plant, "test", seed, count, BLOCK)
    rows = concatenate([_compared(tuner, block, gray_box) for block in blocks])
    errors = {
        TUNER: rows.tuner,
        **({GRAY_BOX: rows.gray_box, SEVERAL: rows.several} if gray_box else {}),
        NOMINAL: rows.nominal,
        ORACLE: np.where(np.isnan(rows.bound), np.nan, 0.0),
    }
    return Comparison(
        errors, rows.bound, rows.informed, rows.verdicts, rows.converged, rows.covered
    )


def _compared(tuner: Tuner, block: Episodes, gray_box: bool) -> _Compared:
    plant, theta = tuner.plant, block.theta
    recording = Recording(block.u, block.y, plant.Ts, theta)
    gains, found = tuner.assess(recording)
    start = recording.parameters(plant)
    if gray_box:
        alone = identify(plant, block.u, block.y, start)
        several = identify_from_several(plant, block.u, block.y, start)
    else:
        alone = several = Identified.none(start)
    right = plant.metric_values(theta, plant.oracle(theta))
    actual = plant.metric_values(theta, gains.values)
    nominal = np.tile(plant.oracle(plant.middle), (len(theta), 1))
    with np.errstate(invalid="ignore"):
        return _Compared(
            actual - right,
            plant.metric_values(theta, plant.oracle(alone.theta)) - right,
            plant.metric_values(theta, plant.oracle(several.theta)) - right,
            plant.metric_values(theta, nominal) - right,
            *bounds(plant, theta, block.u),
            found.verdicts,
            alone.converged,
            np.abs(actual - found.metrics) <= np.array(tuner.calibration) * found.spread,
        )
