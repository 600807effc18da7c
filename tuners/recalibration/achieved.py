"""The margins that a controller achieves, from a drive with it, against those promised.

What the recording alone shows is the black box's response around the crossover
(`tuners.trust.response`), of what the reference explains of command and output, so that neither a
simulator nor the feedback is behind it; without a reference it is rebuilt from command, output and
gains.  A few manoeuvres leave it wide.  The margins on the vehicle that explains the recording's
prediction errors (`tuners.recalibration.watch`) are much narrower: they count unless these errors
are larger than noise or the recording alone contradicts them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from tuners.trust.feedback import rebuilt
from tuners.trust.intervals import GAUSSIAN, Interval
from tuners.tuner.recording import Recording
from tuners.tuner.tuner import Tuner

Array = NDArray[np.float64]

_APART = 3.0  # standard deviations


class Agreement(StrEnum):
    """Whether margins are as promised."""

    KEPT = "as_promised"
    MISSED = "not_as_promised"
    UNKNOWN = "cannot_tell"


@dataclass(frozen=True, slots=True)
class Achieved:
    """Margins of a controller on the plant that it drove.

    Attributes
    ----------
    intervals : dict
        Counted metrics by name: values and 90 % intervals.
    alone : dict
        The same as the recording alone shows them.
    promised : dict
        What they should be.
    agreement : Agreement
        ``cannot_tell`` where an interval is wider than what would be refused of gains.
    """

    intervals: dict[str, Interval]
    alone: dict[str, Interval]
    promised: dict[str, float]
    agreement: Agreement


def achieved(
    tuner: Tuner,
    recording: Recording,
    gains: tuple[float, float],
    promised: Mapping[str, float] | None = None,
    modelled: tuple[Array, Array] | None = None,
) -> Achieved:
    """Margins of gains (kp, Ti) from one recording of the loop with them.

    Parameters
    ----------
    tuner : Tuner
        Its plant says how signals are sampled, and what the loop must reach.
    promised : dict, optional
        Metrics by name; the plant's target if omitted.
    modelled : tuple of NDArray, optional
        Metrics (f,) on a vehicle that explains the recording, and their standard deviations.
    """
    plant, target = tuner.plant, tuner.plant.loop_target
    if target is None:
        raise ValueError("plant.parametrisation: this plant's target is no loop of a PI.")
    if recording.reference is None:
        found = rebuilt(recording.u[0], recording.y[0], recording.Ts, gains, target)
        recording = replace(recording, reference=found[None])
    response, values = tuner.inspection.response(recording), np.array([gains])
    alone = response.metrics(values)[0], response.spread(values)[0]
    metrics, spread = alone if modelled is None or _contradicted(alone, modelled) else modelled
    wanted = dict(zip(plant.counted, (target.phase_margin, target.crossover), strict=True))
    wanted |= promised or {}
    limits, half = [plant.settings[name] for name in plant.counted], GAUSSIAN * spread
    short = np.abs(metrics - np.array(list(wanted.values())))
    if not (half <= [metric.widest for metric in limits]).all():
        agreement = Agreement.UNKNOWN
    elif (short <= np.maximum(half, [metric.error for metric in limits])).all():
        agreement = Agreement.KEPT
    else:
        agreement = Agreement.MISSED
    intervals = _intervals(plant.counted, metrics, spread)
    return Achieved(intervals, _intervals(plant.counted, *alone), wanted, agreement)


def _contradicted(alone: tuple[Array, Array], modelled: tuple[Array, Array]) -> bool:
    """Whether two answers differ by more than their deviations explain."""
    apart = np.abs(alone[0] - modelled[0]) / np.hypot(alone[1], modelled[1])
    return bool((apart > _APART).any())


def _intervals(names: tuple[str, ...], metrics: Array, spread: Array) -> dict[str, Interval]:
    ends = zip(names, metrics, GAUSSIAN * spread, strict=True)
    return {name: Interval(float(m), float(m - h), float(m + h)) for name, m, h in ends}
