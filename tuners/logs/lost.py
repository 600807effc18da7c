"""Samples of a channel that do not measure: where it stands still, or is far from its neighbours.

A sensor that drops out, or a part of a file that was lost, leaves a run of one value, which the
channel reaches or leaves by a jump.  Channels that are quantised, held, or at rest for long repeat
values elsewhere, too, and come to rest smoothly.  Of a channel that is sampled often enough to be
tuned from, the four neighbours of a sample foretell it; one that is as far from that as no other
was lost alone: bits of a file were flipped, or a message was read wrongly.
"""

import numpy as np
from numpy.typing import NDArray

from tuners.logs.table import Array

_ROUNDED = 1e-9  # of nearly all steps: a step that is none
_SHORTEST = 10  # steps without a change
_MOST = 0.2  # of the samples: a channel that stands still for longer is at rest
_QUANTISED = 0.1  # of the other steps: as many without a change are usual
_JUMP = 3.0  # times what nearly all other steps are at most
_NEARLY_ALL = 99.5  # percent
_ENOUGH = 100  # samples
_MOST_ALONE = 98.0  # percent: four lost samples in a thousand spoil twenty
_FAR = 6.0  # times what most samples are from what their neighbours foretell
_SIDES = np.array([-1.0, 4.0, 0.0, 4.0, -1.0]) / 6.0  # a cubic through two samples on either side


def frozen(values: Array) -> NDArray[np.bool_]:
    """Which samples (N,) are of a run of one value with a jump at an end."""
    found = np.zeros(len(values), dtype=np.bool_)
    steps = np.abs(np.diff(values))
    if not len(steps) or not np.isfinite(steps).all():
        return found
    still = steps <= _ROUNDED * np.percentile(steps, _NEARLY_ALL)
    edges = np.flatnonzero(np.diff(still, prepend=False, append=False))
    runs = edges.reshape(-1, 2)  # of steps from the first on, up to the last
    runs = runs[runs[:, 1] - runs[:, 0] >= _SHORTEST]
    inside = np.zeros(len(steps) + 2, dtype=np.bool_)
    for first, last in runs.tolist():
        inside[first : last + 2] = True  # with the steps that lead there and away
    others = steps[~inside[1:-1]]
    if not len(runs) or inside.mean() > _MOST or still[~inside[1:-1]].mean() > _QUANTISED:
        return found
    usual = _JUMP * np.percentile(others, _NEARLY_ALL)
    ends = np.concatenate([[0.0], steps, [0.0]])
    for first, last in runs.tolist():
        if max(ends[first], ends[last + 1]) > usual:
            found[first : last + 1] = True
    return found


def alone(values: Array) -> NDArray[np.bool_]:
    """Which samples (N,) are far from what their neighbours foretell, and no others near them."""
    found = np.zeros(len(values), dtype=np.bool_)
    if len(values) < _ENOUGH or not np.isfinite(values).all():
        return found
    off = np.abs(values[2:-2] - np.convolve(values, _SIDES, "valid"))
    usual = _FAR * np.percentile(off, _MOST_ALONE)
    if not usual > 0:
        return found
    step = np.abs(values[3:-1] - values[1:-3])  # a gap in time is a step, half of which is off
    far = np.flatnonzero(off > np.maximum(usual, step))
    # the neighbours of a lost sample are foretold with it, and are off by up to four sixths of it
    largest = [k for k in far.tolist() if off[k] >= off[max(k - 2, 0) : k + 3].max()]
    for k in largest:
        without = values[k : k + 5].copy()
        without[2] = without @ _SIDES
        rest = np.concatenate([values[max(k - 2, 0) : k], without, values[k + 5 : k + 7]])
        found[k + 2] = bool(
            (np.abs(rest[2:-2] - np.convolve(rest, _SIDES, "valid")) <= usual).all()
        )
    return found


def without_lost(name: str, values: Array) -> tuple[Array, list[str]]:
    """Values (N,) with ``nan`` where they do not measure, and what was left out, in words."""
    still, far = frozen(values), alone(values)
    notes = []
    if still.any():
        notes.append(
            f"Column {name} stands still and then jumps, as a sensor that drops out does: "
            f"{still.sum()} samples were left out."
        )
    if far.any():
        notes.append(
            f"Column {name} has single samples far from those around them: {far.sum()} left out."
        )
    return np.where(still | far, np.nan, values), notes
