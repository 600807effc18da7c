"""Checks of sampling: whether a recording is fast enough, and at the time that it says."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tuners.trust.checks import Assessment
from tuners.trust.verdict import Finding
from tuners.tuner import notes
from tuners.tuner.recording import Recording
from yawrate_env import validation
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]

LONGEST = 200_000
"""Samples of one recording, at most."""

_SLOWEST = 0.1  # sampling time, in periods of the crossover
_COARSEST = 10.0  # sampling time, in those of the experiment, where there is no crossover
_MISSED = 0.01  # of the output's standard deviation: what a spline may miss between samples
_TOO_SLOW = "A spline misses part of the output between these slow samples: record faster."
_STRETCHED = (
    "The input is the experiment's, sample by sample, but the sampling time is not its {:g} s: "
    "check Ts."
)


def slowest(plant: Plant) -> float:
    """Longest sampling time of a usable recording [s]: the plant's own, or longer."""
    longest = _COARSEST * plant.Ts if plant.crossover is None else _SLOWEST / plant.crossover
    return max(longest, plant.Ts)


def check_sampling(plant: Plant, recording: Recording) -> None:
    """``ValueError`` for samples that are too slow, or too many at the plant's sampling time."""
    remedy = "Slower samples do not show what the plant does: record faster."
    validation.number("Ts", recording.Ts, at_most=slowest(plant), remedy=remedy)
    samples = recording.y.shape[-1] * recording.Ts / plant.Ts
    remedy = "Cut to the best part, or decimate."
    name = "number of samples at the tuner's Ts"
    validation.number(name, samples, at_most=LONGEST, remedy=remedy)


def sampled(plant: Plant, recording: Recording, assessment: Assessment) -> Assessment:
    """The same with checks of how the recording was sampled."""
    if recording.Ts > plant.Ts * (1 + notes.ROUNDED):
        values = _between(recording, assessment)
        message = plant.messages.get("between", _TOO_SLOW)
        missed = Finding(values, _MISSED, _MISSED, message)
        assessment = assessment.followed_by({"between": missed})
    if notes.stretched(plant, recording):
        asked = Finding(np.ones(len(recording)), 0.0, 0.0, _STRETCHED.format(plant.Ts))
        assessment = assessment.followed_by({"stretched": asked})
    return assessment


def _between(given: Recording, found: Assessment) -> Array:
    """Relative error of a spline through the fitted plant's output at a slow log's samples."""
    simulated, Ts, N = found.fit.simulated, found.model.Ts, given.y.shape[-1]
    simulated = simulated.reshape(given.y[..., 0].size, -1)
    times, at = Ts * np.arange(simulated.shape[1]), given.Ts * np.arange(N)
    seen = np.stack([np.interp(at, times, row) for row in simulated])
    drawn = replace(given, u=np.zeros((1, N)), y=seen, reference=None).resampled(Ts).y
    with np.errstate(divide="ignore", invalid="ignore"):
        missed = np.mean((drawn - simulated[:, : drawn.shape[1]]) ** 2, axis=1)
        relative = np.sqrt(missed / simulated.var(axis=1))
        return np.asarray(relative.reshape(len(given), -1).max(axis=1))
