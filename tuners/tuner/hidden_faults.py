"""Faults of recordings that a plant's prior hides: another plant of the prior explains them.

Whatever a recording of a plant with one parameter more or less looks like is no fault that a check
can see: of a plant whose gain is unknown a wrong scale of the output, of one whose dead time is
unknown a late log.  Which of the usual faults are of this kind, and what each costs, is found by
making them: one with which recordings are called usable, without care, and miss is hidden.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tuners.trust.findings import MISS
from tuners.tuner.notes import stretched
from tuners.tuner.recording import Recording
from tuners.tuner.tuner import Tuner
from yawrate_env.plant.episodes import recorded
from yawrate_env.plant.names import split
from yawrate_env.plant.plant import Plant

Array = NDArray[np.float64]
Fault = Callable[[Plant, Recording], Recording]

PLANTS = 48
"""Plants of the ``calibration`` set whose recordings get the faults."""

_HIDDEN = 0.03  # share of recordings that are usable without care, and miss
_SCALED, _LATE, _SLOW, _CLIPPED, _OFFSET, _DRIFT = 1.5, 0.008, 1.1, 0.7, 0.3, 0.5
_BAND, _STUCK, _SEED = 0.3, 0.012, 31


@dataclass(frozen=True, slots=True)
class Hidden:
    """One fault that the prior hides.

    Attributes
    ----------
    fault : str
        In words.
    share : float
        Of recordings with it that are called usable, without care, and miss.
    cost : dict
        Root mean square errors of these by metric.
    """

    fault: str
    share: float
    cost: dict[str, float]


def hidden_faults(tuner: Tuner, seed: int = 0) -> list[Hidden]:
    """The faults that recordings of the tuner's plant hide, the commonest first."""
    plant, found = tuner.plant, []
    block = recorded(plant, "calibration", seed, PLANTS)
    given = Recording(block.u, block.y, plant.Ts, block.theta)
    right = plant.metric_values(block.theta, plant.oracle(block.theta))
    most = MISS * plant.metric_setting("error")
    for fault, made in _faults(plant).items():
        recording = made(plant, given)
        if len(recording.u) == 1 and stretched(plant, recording):
            continue  # refused for its input
        if plant.emulator is not None and not plant.emulator.knows(recording.u):
            continue  # it would take as many simulations as all the others
        gains, assessment = tuner.assess(recording)
        error = plant.metric_values(block.theta, gains.values) - right
        missed = (assessment.verdicts == 0) & (~(np.abs(error) <= most)).any(axis=1)
        if missed.mean() > _HIDDEN:
            finite = error[missed & np.isfinite(error).all(axis=1)]
            rms = np.sqrt((finite**2).mean(axis=0)) if len(finite) else np.full(len(most), np.inf)
            cost = dict(zip(plant.counted, rms.tolist(), strict=True))
            found.append(Hidden(fault, float(missed.mean()), cost))
    return sorted(found, key=lambda each: -each.share)


def _faults(plant: Plant) -> dict[str, Fault]:
    """The faults by name; of a plant with several channels those of one of them at a time."""
    if plant.channels is None:
        return _FAULTS
    found: dict[str, Fault] = {}
    for fault, made in _FAULTS.items():
        if made is _slow:
            found[fault] = made
            continue
        named = plant.inputs_named if made in _OF_INPUTS else plant.outputs_named
        for i, name in enumerate(named):
            found[f"{fault} ({split(name)[0]})"] = partial(_of_channel, made, i)
    return found


def _of_channel(made: Fault, i: int, plant: Plant, given: Recording) -> Recording:
    """A recording with the fault in channel `i` alone."""
    whole = made(plant, given)
    u, y = given.u.copy(), given.y.copy()
    if made is _reversed:
        u[:, i] = whole.u[:, i]
    elif made in _ACTUATORS:
        moved = given.u.copy()
        moved[:, i] = _ACTUATORS[made](given.u)[:, i]
        y = y + _difference(plant, given, moved)
    else:
        y[:, i] = whole.y[:, i]
    return replace(given, u=u, y=y)


def sentences(hidden: list[Hidden]) -> list[str]:
    """What to print of them."""
    if not hidden:
        return []
    parts = []
    for each in hidden:
        costs = (" ".join((split(n)[0], f"{v:.2g}", split(n)[1])) for n, v in each.cost.items())
        parts.append(f"  {each.fault}: {each.share:.0%}, off by {', '.join(costs)}")
    return ["Faults that the prior hides, with the share called usable in error, and rms:", *parts]


def _scaled(plant: Plant, given: Recording) -> Recording:
    return replace(given, y=_SCALED * given.y)


def _late(plant: Plant, given: Recording) -> Recording:
    N = given.y.shape[-1]
    late = max(round(_LATE * N), 1)
    first, rest = given.y[..., :1].repeat(late, axis=-1), given.y[..., :-late]
    return replace(given, y=np.concatenate([first, rest], axis=-1))


def _slow(plant: Plant, given: Recording) -> Recording:
    return replace(given, Ts=_SLOW * given.Ts)


def _reversed(plant: Plant, given: Recording) -> Recording:
    return replace(given, u=-given.u)


def _difference(plant: Plant, given: Recording, moved: Array) -> Array:
    """What the plants answer to positions of the actuator in place of the commands."""
    assert given.known is not None
    both = (plant.emulated(u).respond(given.known, u) for u in (moved, given.u))
    actual, commanded = both
    return np.asarray(actual - commanded)


def _clipped(plant: Plant, given: Recording) -> Recording:
    """The plant's answer to a command of which the actuator gives only a part."""
    return replace(given, y=given.y + _difference(plant, given, _at_most(given.u)))


def _loose(plant: Plant, given: Recording) -> Recording:
    return replace(given, y=given.y + _difference(plant, given, _within_band(given.u)))


def _stuck(plant: Plant, given: Recording) -> Recording:
    return replace(given, y=given.y + _difference(plant, given, _at_random(given.u)))


def _at_most(u: Array) -> Array:
    """Inputs of an actuator that saturates."""
    most = _CLIPPED * np.abs(u).max(axis=-1, keepdims=True)
    return np.clip(u, -most, most)


def _within_band(u: Array) -> Array:
    """Positions of an actuator that follows once the command leaves a band around it."""
    v, half = u.copy(), _BAND / 2 * np.ptp(u, axis=-1)
    for k in range(1, u.shape[-1]):
        v[..., k] = np.clip(v[..., k - 1], u[..., k] - half, u[..., k] + half)
    return v


def _at_random(u: Array) -> Array:
    """Positions of an actuator that sticks for a while when the command changes."""
    rng, v, N = np.random.default_rng(_SEED), u.copy(), u.shape[-1]
    longest = max(round(_STUCK * N), 1)
    for row in v.reshape(-1, N):
        free = 0
        for at in (np.flatnonzero(np.diff(row)) + 1).tolist():
            if at > free:  # it has reached the command in between
                free = at + int(rng.integers(longest + 1))
                row[at:free] = row[at - 1]
    return v


def _offset(plant: Plant, given: Recording) -> Recording:
    return replace(given, y=given.y + _OFFSET * given.y.std(axis=-1, keepdims=True))


def _drifting(plant: Plant, given: Recording) -> Recording:
    line = np.linspace(0.0, _DRIFT, given.y.shape[-1])
    return replace(given, y=given.y + line * given.y.std(axis=-1, keepdims=True))


_FAULTS: dict[str, Fault] = {
    f"an output scaled by {_SCALED:g}": _scaled,
    f"an output that is {_LATE:.1%} of the recording late": _late,
    f"a sampling time off by {_SLOW - 1:.0%}": _slow,
    "an input with the wrong sign": _reversed,
    f"an actuator that gives {_CLIPPED:.0%} of the largest command at most": _clipped,
    f"an actuator with a dead band of {_BAND:.0%} of the input's range": _loose,
    f"an actuator that sticks for up to {_STUCK:.1%} of the recording": _stuck,
    "an offset of the output": _offset,
    "a drift of the output": _drifting,
}


_ACTUATORS: dict[Fault, Callable[[Array], Array]] = {
    _clipped: _at_most,
    _loose: _within_band,
    _stuck: _at_random,
}
_OF_INPUTS = _reversed, *_ACTUATORS


def as_record(hidden: list[Hidden]) -> list[dict[str, Any]]:
    """As plain JSON values, for a tuner's record."""
    return [{"fault": each.fault, "share": each.share, "cost": each.cost} for each in hidden]
