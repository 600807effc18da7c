"""Statistics on known examples."""

import numpy as np
import pytest

from studies.metrics import bootstrap_interval, ratio_of_rms, rms, rms_percent


def test_rms_percent_is_relative_to_the_truth():
    # Errors of -10 % and +20 %: root of (100 + 400)/2.
    assert rms_percent(np.array([1.0, -5.0]), np.array([1.1, -4.0])) == pytest.approx(250**0.5)


@pytest.mark.parametrize("level, quantile", [(0.95, 1.960), (0.68, 0.994)])
def test_interval_of_mean_and_std_of_normal_values(level, quantile):
    n = 1500
    values = np.random.default_rng(0).normal(60.0, 0.1, n)
    for statistic, error in ((np.mean, 0.1 / n**0.5), (np.std, 0.1 / (2 * n) ** 0.5)):
        low, high = bootstrap_interval(values, statistic, level=level)
        assert low < statistic(values) < high
        # 2000 resamples give a quantile to 5 %, 1500 values the spread to 2 %, twice each.
        assert high - low == pytest.approx(2 * quantile * error, rel=0.12)


def test_interval_covers_as_often_as_it_says():
    rng = np.random.default_rng(1)
    hits = 0
    for _ in range(100):
        low, high = bootstrap_interval(rng.standard_normal(60), np.mean)
        hits += low < 0 < high
    # Percentile intervals of 60 values cover 94 %; the standard error of 100 trials is 2.4 %.
    assert 0.87 <= hits / 100 <= 0.99


def test_interval_depends_on_its_seed_alone():
    values = np.random.default_rng(2).standard_normal(40)
    assert bootstrap_interval(values, np.std) == bootstrap_interval(values, np.std)
    assert bootstrap_interval(values, np.std) != bootstrap_interval(values, np.std, seed=1)
    for equal in (np.full(10, 3.0), np.array([3.0])):
        assert bootstrap_interval(equal, np.mean) == (3.0, 3.0)


def test_ratio_of_rms_is_that_of_the_two_columns():
    pairs = np.random.default_rng(0).standard_normal((4, 50, 2))
    expected = rms(pairs[2, :, 0]) / rms(pairs[2, :, 1])
    assert ratio_of_rms(pairs, axis=1)[2] == pytest.approx(expected, rel=1e-12)
    low, high = bootstrap_interval(pairs[2], ratio_of_rms)
    assert low < expected < high


def test_columns_of_a_row_stay_together():
    values = np.random.default_rng(4).standard_normal(200)
    pairs = np.stack([3 * values, values], axis=1)
    assert bootstrap_interval(pairs, ratio_of_rms) == pytest.approx((3.0, 3.0))
