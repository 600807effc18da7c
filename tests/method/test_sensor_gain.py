"""A sensor's gain, which is in the loop too: the gains make up for it, and intervals stay."""

import numpy as np
import pytest
from recordings import recorded

from tuners import load

GAIN = 1.03


@pytest.mark.parametrize("coloured", [False, True])
def test_intervals_that_need_no_plant_know_no_sensor_gain(coloured):
    """So that a calibration over sensor gains would be the same one."""
    tuner, recording = load("bb"), recorded(4)
    rng = np.random.default_rng(8)
    drift = rng.standard_normal(recording.y.shape).cumsum(axis=1)
    y = recording.y + coloured * 1e-4 * np.ptp(recording.y) * drift
    for i in range(4):
        one, other = (
            tuner.tune(recording.u[0], g * y[i], recording.Ts, v_x=20.0) for g in (1, GAIN)
        )
        assert one.verdict is other.verdict
        assert other.gains["kp"] == pytest.approx(one.gains["kp"] / GAIN, rel=1e-6)
        assert other.gains["Ti"] == pytest.approx(one.gains["Ti"], rel=1e-6)
        for name, interval in one.intervals.items():
            found = other.intervals[name]
            assert (found.low, found.high) == pytest.approx((interval.low, interval.high), rel=1e-6)
