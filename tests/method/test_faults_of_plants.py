"""Faulty recordings of plants that no recording's own response judges: no miss is called usable."""

from dataclasses import replace

import numpy as np
import pytest
from families import FAMILIES, trained
from families import tested as recordings
from scipy.signal import lfilter

PLANTS = [name for name, plant in FAMILIES.items() if plant.loop_target is None]
COUNT = 6


def backlash(y, width):
    """Outputs (B, N) behind a dead band of a width (B,)."""
    followed = y.copy()
    for k in range(1, y.shape[1]):
        followed[:, k] = np.clip(followed[:, k - 1], y[:, k] - width / 2, y[:, k] + width / 2)
    return followed


def clipped(y, share):
    most = share * np.abs(y).max(axis=1, keepdims=True)
    return np.clip(y, -most, most)


def coloured(n):
    return lfilter([np.sqrt(1 - 0.95**2)], [1, -0.95], n, axis=1)


# Of outputs, their standard deviations (B, 1), times from 0 to 1 and white noise.
FAULTS = {
    "jump": lambda y, s, t, n: y + s * (t > 0.5),
    "offset": lambda y, s, t, n: y + 0.3 * s,
    "drift": lambda y, s, t, n: y + 0.6 * s * t,
    "clipped": lambda y, s, t, n: clipped(y, 0.4),
    "a little clipped": lambda y, s, t, n: clipped(y, 0.7),
    "late": lambda y, s, t, n: np.roll(y, y.shape[1] // 30, axis=1),
    "stuck": lambda y, s, t, n: np.where(t < 0.33, y, y[:, y.shape[1] // 3, None]),
    "random walk": lambda y, s, t, n: y + 0.6 * s * n.cumsum(axis=1) / np.sqrt(n.shape[1]),
    "coloured noise": lambda y, s, t, n: y + 0.3 * s * coloured(n),
    "bent": lambda y, s, t, n: y + 0.1 * y**3 / s**2,
    "backlash": lambda y, s, t, n: backlash(y, 0.3 * s[:, 0]),
    "another lag": lambda y, s, t, n: lfilter([0.1], [1, -0.9], y, axis=1),
    "another gain for half of it": lambda y, s, t, n: y * np.where(t > 0.5, 1.0, 0.6),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("family", PLANTS)
def test_no_miss_is_called_usable(family, fault):
    plant, good = FAMILIES[family], recordings(family).part(slice(0, COUNT))
    times = np.linspace(0, 1, good.y.shape[1])
    noise = np.random.default_rng(0).standard_normal(good.y.shape)
    y = FAULTS[fault](good.y, good.y.std(axis=1, keepdims=True), times, noise)
    gains, found = trained(family).assess(replace(good, y=y))
    error = np.abs(plant.errors(good.known, gains.values)) / plant.metric_setting("error")
    hit = (error <= 2).all(axis=1)
    assert (hit | (found.verdicts > 0)).all()
