"""The polynomial as a learner."""

import numpy as np
import pytest

from tuners.learners.polynomial import Polynomial, PolynomialSettings, monomials, polynomial

RNG = np.random.default_rng(0)
Z = RNG.standard_normal((600, 3))
X = np.column_stack([Z[:, 0], Z[:, 0] + 1e-3 * Z[:, 1], 1e4 * Z[:, 2], np.full(600, 7.0)])
T = np.column_stack([Z[:, 0] * Z[:, 1] * Z[:, 2] + Z[:, 2], 1 + Z[:, 1] ** 3])


def test_polynomials_have_every_monomial_once():
    x = np.array([[2.0, 3.0]])
    np.testing.assert_array_equal(polynomial(x, 1), [[1, 2, 3]])
    np.testing.assert_array_equal(polynomial(x, 2), [[1, 2, 3, 4, 6, 9]])
    np.testing.assert_array_equal(polynomial(x, 3), [[1, 2, 3, 4, 6, 9, 8, 12, 18, 27]])
    assert len(monomials(13, 3)) == 455


def test_a_cubic_of_badly_scaled_features_is_found_exactly_in_parts_too():
    parts = [(X[i : i + 200], T[i : i + 200]) for i in range(0, 600, 200)]
    model = PolynomialSettings(3).fit(parts[:2], parts[2:], 0)
    np.testing.assert_allclose(model(X), T, atol=1e-6)
    square = PolynomialSettings(2).fit(parts[:2], parts[2:], 0)
    assert np.abs(square(X) - T).max() > 0.5


def test_arrays_round_trip_exactly_and_must_go_together():
    model = PolynomialSettings(2).fit([(X, T)], [], 0)
    arrays = model.arrays()
    np.testing.assert_array_equal(Polynomial.from_arrays(arrays)(X), model(X))
    for name, changed in (
        ("degree", np.array(4)),
        ("coefficients", arrays["coefficients"][1:]),
        ("mean", arrays["mean"][1:]),
    ):
        with pytest.raises(ValueError, match=name):
            Polynomial.from_arrays(arrays | {name: changed})


def test_a_degree_that_nothing_fits_is_refused():
    for degree in (0, 4, 1.5):
        with pytest.raises(ValueError, match="degree"):
            PolynomialSettings(degree)
