"""Memory of the earlier windows of ``yawrate/PIRecalibration-v0``, with free settings.

An observation tells two estimates z and their covariance C, in standard deviations of a prior.
Memory is a normal distribution that follows them (`tuners.recalibration.belief`): between windows
it widens, and the first number may jump.  How much, and how often, are settings: they are not told,
but learned from rewards (`tuners.agents.recalibrator`).

| setting | meaning |
|---|---|
| 0, 1 | logarithms of the variances that each number gains from window to window |
| 2 | how the first one's changes with its value |
| 3 | log odds that it jumps, to anywhere in its prior |
| 4 | logarithm of what the estimates' information counts |
"""

import numpy as np
from numpy.typing import NDArray

from tuners.recalibration.belief import Belief, Motion, follow
from yawrate_env.batch import replaced

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Observations = NDArray[np.floating]

FORGETFUL = np.array([-4.0, -4.0, 0.0, -4.0, 0.0])
"""Settings to begin with: an estimate counts for some windows."""

NUMBERS = 3
"""That `inputs` gives."""

_LARGEST = 12.0  # size of a setting
_FARTHEST = 3.0  # standard deviations of the prior, beyond which no mean goes


def within(settings: Array) -> Array:
    """Settings whose exponentials are numbers."""
    return np.clip(settings, -_LARGEST, _LARGEST)


def blank(count: int) -> Belief:
    """Memories before the first window: the prior."""
    return Belief(np.zeros((count, 2)), np.tile(np.eye(2), (count, 1, 1)), np.zeros(count))


def remembered(settings: Array, memory: Belief, obs: Observations, starts: Flags) -> Belief:
    """Memories (B,) after one more observation each.

    Parameters
    ----------
    settings : (5,) or (B, 5) float64
    obs : (B, 9) float
        Observations.
    starts : (B,) bool
        Which are the first of a drive: what was before is forgotten.
    """
    first = np.flatnonzero(starts)
    memory = replaced(memory, first, blank(len(first)))
    q1, q2, bent, odds, counts = np.atleast_2d(settings).T
    walk = np.empty_like(memory.mean)
    walk[:, 0] = np.exp(q1 + np.clip(bent * memory.mean[:, 0], -_LARGEST, _LARGEST))
    walk[:, 1] = np.exp(q2)
    walk[first] = 0.0
    motion = Motion(walk, 1 / (1 + np.exp(-odds)), 0, 0.0, 1.0)
    F, i = _told(obs)
    found = follow(memory, motion, scaled(counts, F), scaled(counts, i))
    return Belief(np.clip(found.mean, -_FARTHEST, _FARTHEST), found.covariance, found.jumped)


def replayed(settings: Array, obs: Observations, starts: Flags) -> Array:
    """`inputs` (P, T B, 3) for each of P settings (P, 5) after every observation (T, B, 9)."""
    P, (T, B) = len(settings), starts.shape
    each, memory, found = np.repeat(settings, B, axis=0), blank(P * B), np.empty((P, T, B, NUMBERS))
    for t in range(T):
        now = np.tile(obs[t], (P, 1))
        memory = remembered(each, memory, now, np.tile(starts[t], P))
        found[:, t] = inputs(memory, now).reshape(P, B, NUMBERS)
    return found.reshape(P, T * B, NUMBERS)


def inputs(memory: Belief, obs: Observations) -> Array:
    """What actions depend on, (B, 3): the means, and the speed to come."""
    return np.column_stack([memory.mean, obs[:, 8]])


def scaled(logarithm: Array, values: Array) -> Array:
    """Information (B, ...) times a factor (B,) or (1,)."""
    return np.asarray(np.exp(logarithm).reshape(-1, *[1] * (values.ndim - 1)) * values)


def _told(obs: Observations) -> tuple[Array, Array]:
    """Information F (B, 2, 2) of the windows without the prior, and F z (B, 2)."""
    values = obs.astype(np.float64)
    spread = np.exp(values[:, 2:4])
    C = spread[:, :, None] * spread[:, None]
    for i, j in ((0, 1), (1, 0)):
        C[:, i, j] *= np.clip(values[:, 4], -0.9999, 0.9999)
    precision = np.asarray(np.linalg.inv(C), dtype=np.float64)
    return precision - np.eye(2), (precision * values[:, None, :2]).sum(axis=2)
