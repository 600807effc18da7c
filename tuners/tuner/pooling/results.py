"""The results of several recordings: what `Tuner.pool` does."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tuners.trust.checks import Assessment
from tuners.tuner.answers import Answers
from tuners.tuner.inspection import Inspection
from tuners.tuner.look import Look
from tuners.tuner.method import Method, Rung
from tuners.tuner.pooling import remarks
from tuners.tuner.pooling.pool import DISAGREE, Pool
from tuners.tuner.pooling.pooling import Pooling
from tuners.tuner.pooling.validation import validation as validation_of
from tuners.tuner.recording import Recording
from tuners.tuner.result import Result
from tuners.tuner.sampling import sampled
from yawrate_env import validation
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]


class Answering(Protocol):
    """What is needed of a `Tuner`."""

    method: Method
    calibration: tuple[float, ...]
    inspection: Inspection

    @property
    def plant(self) -> Plant:
        """The plant that it tunes."""

    @property
    def answers(self) -> Answers:
        """What makes results of climbed recordings."""

    def results(self, recording: Recording, start: str = "auto") -> tuple[Result, ...]:
        """Results for every episode."""


def pools(
    tuner: Answering,
    recordings: Sequence[Recording],
    ats: Sequence[Mapping[str, float] | None],
    given_names: Sequence[str],
    validate: Recording | None,
    start: str,
) -> tuple[Result, ...]:
    """Results of several recordings at operating points, or at the one they have in common."""
    validation.count("number of recordings", len(recordings), remedy="Give one or more.")
    plant, given = tuner.plant, [*recordings, *([] if validate is None else [validate])]
    looks = [
        replace(tuner.inspection.look(recording, start), name=name)
        for recording, name in zip(given, names(given, given_names), strict=True)
    ]
    further, looks = looks[len(recordings) :], looks[: len(recordings)]
    points = [operating_point(plant, looks, at) for at in ats]

    def recorded(recording: Recording, assessment: Assessment) -> Assessment:
        return sampled(tuner.plant, recording, assessment).followed_by(
            tuner.inspection.looped(recording)
        )

    pooling = Pooling(plant, tuner.method, recorded)
    joint = pooling.fit(looks)
    results = []
    for theta, at in zip(points, ats, strict=True):
        pool = pooling.pool(looks, joint, theta, tuner.inspection.known(theta))
        if len(looks) == 1 and at is None:
            (result,) = tuner.results(looks[0].given, start)
        else:
            result = _pooled(tuner, pooling, looks, pool)
        for each in further:
            held = validation_of(pooling, looks, each, pool, result, tuner.calibration)
            result = replace(result, validation=held)
        results.append(result)
    return tuple(results)


def _pooled(tuner: Answering, pooling: Pooling, looks: Sequence[Look], pool: Pool) -> Result:
    """The result of recordings at one operating point."""
    plant, theta = tuner.plant, pool.theta
    shares = remarks.shares(plant, looks, pool, pooling.alone)
    answering = near(pooling, looks, pool)
    if answering:  # the plant does not answer, but recordings of this operating point do
        pool = pooling.pool(answering, pooling.fit(answering), theta, tuner.inspection.known(theta))
    else:
        pool, answering = pool.explained(remarks.disagreements(shares)), list(looks)
    seconds = sum(look.given.y.shape[-1] * look.given.Ts for look in answering)
    said = remarks.notes(plant, answering, pool, shares, tuner.method.any_experiment)
    if len(answering) < len(looks):
        said = (*only(answering), *said)
    why = remarks.left(plant, answering, pool)
    result = tuner.answers.of(pool.climbed, pool.assessment, 0, why, said, seconds)
    return replace(result, logs=shares)


def names(recordings: Sequence[Recording], given: Sequence[str]) -> list[str]:
    """Names of recordings, checked: one for each, or none."""
    for i, recording in enumerate(recordings):
        remedy = "Make one with Recording.of(plant, u, y, Ts)."
        validation.instance(f"recordings[{i}]", recording, Recording, remedy=remedy)
        if len(recording) != 1:
            raise ValueError(
                f"recordings[{i}] has {len(recording)} episodes, not 1. Give its parts one by one."
            )
        for k in range(i):
            if _same(recording, recordings[k]):
                raise ValueError(
                    f"recordings[{i}] is recordings[{k}] once more: the same information does not "
                    "count twice. Leave one out."
                )
    if given and len(given) != len(recordings):
        raise ValueError(
            f"names has {len(given)} names for {len(recordings)} recordings. Give one for each."
        )
    return list(given) or [f"recording {i + 1}" for i in range(len(recordings))]


def _same(one: Recording, other: Recording) -> bool:
    return np.array_equal(one.y, other.y) and np.array_equal(one.u, other.u)


def near(pooling: Pooling, looks: Sequence[Look], pool: Pool) -> list[Look]:
    """Recordings of the wanted operating point, where those of others contradict the plant."""
    (check,) = (each for each in pool.assessment.checks(0) if each.name == DISAGREE)
    answered = pool.climbed.rung[0] != Rung.NONE and check.passed
    if answered or pooling.plant.loop_target is None:
        return []
    found = [look for look in looks if pooling.together([look], pool.theta)]
    return found if len(found) < len(looks) else []


def only(near: Sequence[Look]) -> tuple[str, ...]:
    """A note where the others do not count."""
    names = ", ".join(look.name for look in near)
    return (
        "No plant fitted to all recordings reproduces them: the gains come from those of this "
        f"operating point alone ({names}).",
    )


def operating_point(plant: Plant, looks: Sequence[Look], at: Mapping[str, float] | None) -> Array:
    """Measured parameters (B, p) that gains are for: those given, or in common.

    Raises
    ------
    ValueError
        Recordings differ by more than the plant's measured parameters may, and none is given.
    """
    theta = looks[0].theta.copy()
    for name, slack in plant.measured.items():
        (i,) = plant.indices((name,))
        values = np.stack([look.theta[:, i] for look in looks])
        theta[:, i] = values.mean(axis=0)
        if at is not None and name in at:
            theta[:, i] = plant.check_value(name, at[name])
        elif (np.ptp(values, axis=0) > 2 * slack).any():
            label, unit = split(plant.label(name))
            raise ValueError(
                f"{label} runs from {values.min():.3g} to {values.max():.3g} {unit} over these "
                f"recordings, and gains are for one. Give it, at={{{name!r}: "
                f"{values.mean():.3g}}} (--measured {label}={values.mean():.3g}), or make a table "
                "over all of them with `yawrate schedule`."
            )
    return theta
