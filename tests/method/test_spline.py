"""The spline that resamples recordings, beside SciPy's."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, make_interp_spline

from tuners.trust.fast_length import fast_length
from tuners.tuner.spline import slopes, spline


@pytest.mark.parametrize("N", [4, 5, 6, 7, 40, 2000])
def test_splines_are_scipys(N):
    rng = np.random.default_rng(N)
    y, at = rng.normal(size=(3, N)).cumsum(axis=1), np.sort(rng.uniform(0, N - 1, 500))
    at[:2] = 0, N - 1
    expected = CubicSpline(np.arange(N), y, axis=1)(at)
    np.testing.assert_allclose(spline(y, at), expected, rtol=0, atol=1e-12 * np.abs(y).max())
    if N >= 7:
        theirs = make_interp_spline(np.arange(N), y, k=3, axis=1)(at)
        np.testing.assert_allclose(spline(y, at), theirs, rtol=0, atol=1e-11 * np.abs(y).max())


@pytest.mark.parametrize("N", [4, 5, 6, 40, 300])
def test_slopes_at_any_places_are_scipys(N):
    rng = np.random.default_rng(N)
    x, y = np.cumsum(rng.uniform(0.1, 1.0, N)), rng.normal(size=N)
    expected = CubicSpline(x, y)(x, 1)
    np.testing.assert_allclose(slopes(x, y), expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_cubics_are_met_exactly():
    at = np.linspace(-0.1, 30.2, 97)
    cubic = np.polynomial.Polynomial([1.0, -0.5, 0.02, -0.001])
    np.testing.assert_allclose(spline(cubic(np.arange(31.0))[None], at)[0], cubic(at), atol=1e-12)


def test_lengths_of_transforms_are_products_of_2_3_and_5():
    for n in [*range(1, 200), 10_007, 999_983]:
        k = m = fast_length(n)
        for prime in (2, 3, 5):
            while m % prime == 0:
                m //= prime
        assert m == 1 and n <= k < 2 * n
    assert [fast_length(n) for n in (7, 11, 13, 17, 10_007)] == [8, 12, 15, 18, 10_125]
