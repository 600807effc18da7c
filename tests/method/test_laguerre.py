"""Laguerre features against their definition and SciPy's filters."""

import numpy as np
import pytest
from scipy.signal import lfilter

from tuners.features.integrated import Integrated
from tuners.features.laguerre import Laguerre
from yawrate_env.signals.excitation import prbs

TS = 0.001
U = prbs(10_000, TS, 0.1, np.radians(1))
NOISE = np.random.default_rng(0).standard_normal((3, U.shape[1]))


def test_regressors_are_the_filters_of_the_definition():
    a = np.exp(-12.0 * TS)
    expected = [lfilter([0, np.sqrt(1 - a * a)], [1, -a], U[0])]
    for _ in range(9):
        expected.append(lfilter([-a, 1], [1, -a], expected[-1]))
    found = Laguerre().regressors(U, TS)[0]
    # Rounding of ten filters with memories of 80 samples.
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("count", [2, 16, 17])
def test_an_episodes_features_do_not_depend_on_the_batch(count):
    u, y = np.random.default_rng(6).standard_normal((2, 40, 2000))
    whole, part = Laguerre()(u, y, TS)[0], Laguerre()(u[:count], y[:count], TS)[0]
    np.testing.assert_array_equal(part, whole[:count])
    whole, part = Laguerre()(u[:1], y, TS)[0], Laguerre()(u[:1], y[:count], TS)[0]
    np.testing.assert_allclose(part, whole[:count], rtol=1e-11)  # BLAS sums in another order


@pytest.mark.parametrize("inputs", ["shared", "own"])
@pytest.mark.parametrize("order", [1, 8])
@pytest.mark.parametrize("extras", [0, 9])
def test_further_regressors_against_lstsq(inputs, order, extras):
    rng, basis = np.random.default_rng(4), Laguerre(order)
    extra, y = rng.standard_normal((extras, 2000)), rng.standard_normal((17, 2000))
    u = rng.standard_normal((1 if inputs == "shared" else 17, 2000))
    phi = np.broadcast_to(basis.regressors(u, TS), (17, order, 2000))
    expected = [
        np.linalg.lstsq(np.concatenate([own, extra]).T, out)[0]
        for own, out in zip(phi, y, strict=True)
    ]
    found = basis.coefficients(u, y, TS, extra)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("N", [150, 9999])
@pytest.mark.parametrize("kind", ["white", "drift", "burst"])
def test_gram_matrix_from_its_first_row(kind, N):
    rng = np.random.default_rng(5)
    u = {
        "white": rng.standard_normal((20, N)),
        "drift": rng.standard_normal((20, N)).cumsum(axis=1),  # far from white, ends far from 0
        "burst": np.where(np.arange(N) < N - 9, 0.0, rng.standard_normal((20, N))),
    }[kind]
    basis = Laguerre(8)
    phi = basis.regressors(u, TS)
    gram, right = basis.normal_equations(u, u[::-1], TS, np.empty((0, N)))
    scale = np.trace(phi @ phi.transpose(0, 2, 1), axis1=1, axis2=2)[:, None, None]
    np.testing.assert_allclose(gram / scale, phi @ phi.transpose(0, 2, 1) / scale, atol=1e-14)
    np.testing.assert_allclose(right, (phi @ u[::-1, :, None])[..., 0], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("basis", [Laguerre(7), Integrated(3, 5.0)])
@pytest.mark.parametrize("count", [1, 17])
def test_averages_are_those_of_the_filtered_inputs(basis, count):
    u, size = np.random.default_rng(7).standard_normal((count, 500)), 7
    blocks = basis.regressors(u, TS)[..., : 500 // size * size].reshape(
        count, basis.order, -1, size
    )
    found = basis.averages(u, TS, size)
    np.testing.assert_allclose(found, blocks.mean(axis=-1), atol=1e-12 * np.abs(blocks).max())


@pytest.mark.parametrize("inputs", ["shared", "own"])
def test_useless_episodes_are_not_usable(inputs):
    y = NOISE.copy()
    y[1, 5] = np.nan
    u = U if inputs == "shared" else np.repeat(U, 3, axis=0)
    assert Laguerre()(u, y, TS)[1].tolist() == [True, False, True]
    assert not Laguerre()(0 * u, NOISE, TS)[1].any()


def test_a_recording_that_is_too_short_is_refused():
    with pytest.raises(ValueError, match="99 samples"):
        Laguerre()(U[:, :99], NOISE[:, :99], TS)
    assert Laguerre()(U[:, :100], NOISE[:, :100], TS)[0].shape == (3, 10)
