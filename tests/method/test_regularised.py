"""Regularised features against their definition, and what they are for."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from tuners.features import features_named, settings_of
from tuners.features.laguerre import Laguerre
from tuners.features.regularised import Regularised, regularised
from yawrate_env.signals.excitation import prbs

TS, FUNCTIONS = 0.02, Laguerre(12, 3.0)
WORDS = np.arange(1, 7, dtype=np.uint64)
U = prbs(500, TS, 0.5, 1.0, order=14, start=WORDS)
RNG = np.random.default_rng(0)
MEAN, SPREAD = RNG.standard_normal(12), RNG.standard_normal((3, 12))
COEFFICIENTS = MEAN + RNG.standard_normal((2000, 3)) @ SPREAD
SIGMA = 3.0


def responses(coefficients):
    return np.einsum("bn,bnk->bk", coefficients, FUNCTIONS.regressors(U, TS))


def made(coefficients, sigma=SIGMA):
    """The features that know these, of recordings of one of the inputs each."""
    gram, _ = FUNCTIONS.normal_equations(U, U, TS, np.empty((0, 500)))
    gram = gram[np.arange(len(coefficients)) % 6]
    right = (gram @ coefficients[..., None])[..., 0]
    return regularised(FUNCTIONS, gram, right, np.full(len(coefficients), sigma**2))


STAGE = made(COEFFICIENTS)


def test_directions_are_those_of_the_simulated_plants():
    W = np.array(STAGE.directions)
    assert W.shape == (3, 12)
    np.testing.assert_allclose(W.T @ W, np.cov(COEFFICIENTS.T), atol=1e-7)
    np.testing.assert_allclose(STAGE.mean, COEFFICIENTS.mean(axis=0), rtol=1e-8)


def test_directions_that_noise_hides_are_left_out():
    alike = COEFFICIENTS + 1e-3 * RNG.standard_normal(COEFFICIENTS.shape)
    assert len(made(alike).directions) == 3
    assert len(made(alike, 1e-4).directions) == 12
    assert len(made(COEFFICIENTS, 1e6).directions) == 1


def test_with_noise_they_are_the_posterior_mean():
    z = RNG.standard_normal((6, 3))
    m, W = np.array(STAGE.mean), np.array(STAGE.directions)
    y = responses(m + z @ W) + SIGMA * RNG.standard_normal((6, 500))
    features, _ = STAGE(U, y, TS)
    for row, phi, found in zip(y, FUNCTIONS.regressors(U, TS), features, strict=True):
        # Gaussian conditioning of z on the samples, the textbook's other form.
        H = W @ phi
        gain = H @ np.linalg.inv(H.T @ H + STAGE.variance * np.eye(500))
        np.testing.assert_allclose(found, gain @ (row - m @ phi), atol=1e-6)


def test_one_input_for_all_is_one_for_each():
    y = RNG.standard_normal((6, 500))
    shared, _ = STAGE(U[:1], y, TS)
    np.testing.assert_allclose(STAGE(np.repeat(U[:1], 6, axis=0), y, TS)[0], shared, rtol=1e-8)


def test_rows_do_not_depend_on_the_batch():
    y = RNG.standard_normal((6, 500))
    together, _ = STAGE(U, y, TS)
    for i in range(0, 6, 2):
        np.testing.assert_array_equal(STAGE(U[i : i + 2], y[i : i + 2], TS)[0], together[i : i + 2])


def test_nothing_is_read_from_silence():
    features, usable = STAGE(np.zeros((1, 500)), np.ones((2, 500)), TS)
    assert not usable.any()
    assert np.isfinite(features).all()
    y = np.ones((2, 500))
    y[1, 3] = np.nan
    assert STAGE(U[:2], y, TS)[1].tolist() == [True, False]


@pytest.mark.parametrize("stage", [STAGE, FUNCTIONS], ids=["regularised", "laguerre"])
def test_an_input_that_moves_at_the_last_sample_only_comes_too_late(stage):
    u = np.zeros((1, 500))
    u[0, -1] = 1.0
    assert not stage(u, RNG.standard_normal((1, 500)), TS)[1].any()
    u[0, -2] = 1.0
    assert stage(u, RNG.standard_normal((1, 500)), TS)[1].all()


@pytest.mark.parametrize("coefficients", [np.zeros((5, 12)), np.full((5, 12), np.inf)])
def test_inputs_that_tell_nothing_are_refused(coefficients):
    with pytest.raises(ValueError, match="inputs"):
        made(coefficients)


def test_it_goes_through_a_file():
    written = json.loads(json.dumps(settings_of(STAGE)))
    assert written["name"] == "regularised"
    assert features_named(**written) == STAGE
    assert hash(STAGE) == hash(replace(STAGE))


def test_bad_settings_are_refused():
    settings = asdict(STAGE)
    row = settings["directions"][0]
    for changes, words in (
        ({"order": 0}, "order = 0"),
        ({"order": 2.5}, "order = 2.5"),
        ({"pole": -1.0}, "pole = -1"),
        ({"pole": "fast"}, "pole = 'fast'"),
        ({"mean": (1.0,)}, "mean has shape"),
        ({"mean": 3}, "mean has shape"),
        ({"mean": (np.nan, *MEAN[1:])}, "mean has nan"),
        ({"directions": (row[:-1],)}, "directions has shape"),
        ({"variance": -1.0}, "variance = -1"),
        ({"directions": ()}, "directions has shape"),
        ({"directions": (row, row)}, "2 directions"),
    ):
        with pytest.raises(ValueError, match=words):
            Regularised(**settings | changes)
    with pytest.raises(ValueError, match="20 samples are too few for 12"):
        STAGE(U[:, :20], U[:, :20], TS)
