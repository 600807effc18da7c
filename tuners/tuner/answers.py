"""The result of a recording: gains, intervals, verdict, notes and fallback in one record."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.trust.checks import Assessment
from tuners.trust.intervals import Interval
from tuners.trust.verdict import worst
from tuners.tuner import notes
from tuners.tuner.gain_intervals import exact_gain_intervals, gain_intervals
from tuners.tuner.ladder import Climb
from tuners.tuner.method import Rung
from tuners.tuner.reasons import reasons
from tuners.tuner.result import FittedPlant, Result
from yawrate_env.loop.design import Status
from yawrate_env.plant.plant import Plant
from yawrate_env.plant.responses import OpenLoop

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """Makes the results of one tuner.

    Attributes
    ----------
    plant : Plant
        The tuner's.
    calibration, exact_calibration : tuple of float
        Half widths of the metrics' intervals, as `tuners.Tuner` has them.
    fallback : NDArray
        (k,) gains that are stable for every plant of the prior.
    notes : tuple of str
        On every recording.
    """

    plant: Plant
    calibration: tuple[float, ...]
    exact_calibration: tuple[float, ...]
    fallback: Array
    notes: tuple[str, ...]

    def of(
        self,
        climbed: Climb,
        found: Assessment,
        i: int,
        why: tuple[str, ...],
        said: tuple[str, ...],
        seconds: float,
        slopes: Array | None = None,
    ) -> Result:
        """The result of recording `i`.

        Parameters
        ----------
        why : tuple of str
            Why higher rungs were left.
        said : tuple of str
            Notes on the recording.
        seconds : float
            How long it is.
        slopes : (B, k, q) float64, optional
            `design_slopes` at the fitted plants.
        """
        plant, checks, gains = self.plant, found.checks(i), climbed.gains
        rung, values = Rung(climbed.rung[i]), gains.values[i]
        alone = rung >= Rung.BLACK_BOX
        return Result(
            gains=self._named(values),
            intervals=_intervals(plant, found.metrics[i], found.spread[i], self.calibration),
            exact_intervals=_intervals(
                plant, found.exact_metrics[i], found.exact_spread[i], self.exact_calibration
            ),
            status=Status(gains.status[i]),
            converged=bool(gains.converged[i]),
            verdict=worst([check.verdict for check in checks]),
            rung=rung,
            left=why,
            reasons=reasons(plant, checks, why, rung),
            notes=said + self.notes + notes.slow_integral(plant, values, seconds),
            fallback=self._named(self.fallback),
            checks=checks,
            gain_intervals=gain_intervals(plant, values, found, i, max(self.calibration)),
            exact_gain_intervals=exact_gain_intervals(plant, values, found, i, slopes=slopes),
            fit=FittedPlant.of(plant, found, i, alone),
            open_loop=_open_loop(values, found, i) if alone else None,
            response=None if found.response is None else found.response.part(i),
            plant=self.plant,
        )

    def _named(self, gains: Array) -> dict[str, float]:
        return dict(zip(self.plant.gains, map(float, gains), strict=True))


def _intervals(
    plant: Plant, metrics: Array, spread: Array, factors: tuple[float, ...]
) -> dict[str, Interval]:
    """Metrics (f,) plus and minus factors times their standard deviations (f,), by name."""
    ends = zip(plant.counted, metrics, np.array(factors) * spread, strict=True)
    return {name: Interval(float(v), float(v - h), float(v + h)) for name, v, h in ends}


def _open_loop(gains: Array, found: Assessment, i: int) -> OpenLoop | None:
    """What the recording alone shows of the loop; None where there is nothing to show."""
    if found.response is None or not np.isfinite(gains).all():
        return None
    return found.response.open_loop(gains, i)
