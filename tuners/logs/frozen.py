"""Samples at which a channel stands still although what it measures moves.

A sensor that drops out, or a part of a file that was lost, leaves a run of one value, which the
channel reaches or leaves by a jump.  Channels that are quantised, held, or at rest for long repeat
values elsewhere, too, and come to rest smoothly.
"""

import numpy as np
from numpy.typing import NDArray

from tuners.logs.table import Array

_SHORTEST = 10  # steps without a change
_MOST = 0.2  # of the samples: a channel that stands still for longer is at rest
_QUANTISED = 0.1  # of the other steps: as many without a change are usual
_JUMP = 3.0  # times what nearly all other steps are at most
_NEARLY_ALL = 99.5  # percent


def frozen(values: Array) -> NDArray[np.bool_]:
    """Which samples (N,) are of a run of one value with a jump at an end."""
    found = np.zeros(len(values), dtype=np.bool_)
    steps = np.abs(np.diff(values))
    if not len(steps) or not np.isfinite(steps).all():
        return found
    edges = np.flatnonzero(np.diff(steps == 0, prepend=False, append=False))
    runs = edges.reshape(-1, 2)  # of steps from the first on, up to the last
    runs = runs[runs[:, 1] - runs[:, 0] >= _SHORTEST]
    inside = np.zeros(len(steps) + 2, dtype=np.bool_)
    for first, last in runs.tolist():
        inside[first : last + 2] = True  # with the steps that lead there and away
    others = steps[~inside[1:-1]]
    if not len(runs) or inside.mean() > _MOST or (others == 0).mean() > _QUANTISED:
        return found
    usual = _JUMP * np.percentile(others, _NEARLY_ALL)
    ends = np.concatenate([[0.0], steps, [0.0]])
    for first, last in runs.tolist():
        if max(ends[first], ends[last + 1]) > usual:
            found[first : last + 1] = True
    return found


def note(name: str, samples: int) -> str:
    """What was left out of a channel, in words."""
    return (
        f"Column {name} stands still and then jumps, as a sensor that drops out does: {samples} "
        "samples were left out."
    )
